"""Surfaces of bicubic patches: what a file says of them, and the solid that they bound."""
