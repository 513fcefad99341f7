"""How often the test of the order of rows raises an alarm: on stable processes, and on those that drift."""
