"""Pictures of one run, drawn with matplotlib without a window: curves over time, and the mechanism in motion."""
