"""Capability indices of a response and their intervals."""
