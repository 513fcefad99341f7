"""What Numba lacks: tuples of arrays by address, a memory of choices and sizes, no search for garbage."""
