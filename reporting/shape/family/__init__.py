"""Families of distributions: closed forms, parameters in the unit of the values, and maximum likelihood."""
