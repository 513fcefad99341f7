"""A mechanism at its start, as lines and words on a canvas, and such a canvas as a figure."""
