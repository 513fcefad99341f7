"""Families of distributions: closed forms, what their parameters mean, and where a likelihood is largest."""
