"""What the store holds, looked at by one reader for all: an index of campaigns, and a feed of each that is followed."""
