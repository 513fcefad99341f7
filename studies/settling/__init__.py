"""Comparison of settlings of the C-60: their cost, and the dependence of the result on the steps.

The rest position of a mechanism with friction depends on its history. Each settling closes the clearances of the same
samples with four step sizes; the rest position must not depend on them. Nothing is chosen by the paper's numbers.
"""
