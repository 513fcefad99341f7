"""How far a campaign is, counted from what the store holds."""
