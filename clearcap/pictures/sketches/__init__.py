"""Sketches of a mechanism at its start, as lines and words on a canvas, and their figures."""
