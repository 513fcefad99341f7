"""Pictures of one run: curves over time, and the mechanism as it moves; drawn with matplotlib's objects, no window."""
