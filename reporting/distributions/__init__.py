"""Distributions for all purposes: drawn as inputs of a campaign, fitted to responses, exchanged by a what-if.

Workers import these modules, so they need no more than numpy and ``scipy.special``.
"""
