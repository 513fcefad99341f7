"""Pages for the rows of a campaign: what-if, samples, comparison, export."""
