"""Faults of a file or a value as data, with their positions in the text."""
