"""Surfaces of bicubic patches: their representation in a file, and the solid that they bound."""
