"""One reader of the store for all users: an index of the campaigns, and a feed of each followed campaign."""
