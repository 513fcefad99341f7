"""What makes Numba compile faster, and all that is used of Numba beyond its manual."""
