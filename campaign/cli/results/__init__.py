"""Verbs that read a store and simulate nothing, one per module."""
