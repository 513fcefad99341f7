"""What mean and spread of the C-60's contact force depend on: the tables of docs/c60-force.md.

Each variant changes one assumption of the campaign `c60_paper`, or a few together, and simulates the same first
samples. Nothing is fitted.
"""
