"""The trust card: whether the numbers of the report are reliable."""
