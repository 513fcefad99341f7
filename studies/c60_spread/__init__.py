"""Influences on mean and spread of the C-60's contact force: the tables of docs/c60-force.md.

Each variant changes one assumption of the campaign `c60_paper`, or a few of them, and simulates the same first
samples. Nothing is fitted.
"""
