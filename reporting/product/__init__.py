"""Yield of the whole product (all limits kept together), and the causes of its loss."""
