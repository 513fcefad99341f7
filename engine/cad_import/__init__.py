"""Propose a mechanism file from a CAD file: the features found, and questions about what only a person knows."""
