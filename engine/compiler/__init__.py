"""Additions to Numba: tuples of arrays passed by address, remembered choices and sizes, no garbage collection."""
