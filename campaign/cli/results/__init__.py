"""Verbs that read what a store holds and simulate nothing: one a module."""
