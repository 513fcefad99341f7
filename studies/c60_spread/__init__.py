"""Influences on mean and spread of the C-60's contact force: the tables of studies/c60_spread/README.md.

Each variant changes one assumption of the campaign `c60_paper`, or a few of them, and simulates the same first
samples. Nothing is fitted.
"""
