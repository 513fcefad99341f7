"""What Numba lacks: tuples of arrays by address, and a memory of its choices."""
