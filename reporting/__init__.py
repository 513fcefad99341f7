"""Capability reports from a table of samples: numbers, figures, pages."""
