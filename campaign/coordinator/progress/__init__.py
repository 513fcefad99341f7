"""The progress of a campaign, counted from the content of the store."""
