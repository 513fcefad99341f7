"""Yield of the whole product: all limits kept together, and what costs it."""
