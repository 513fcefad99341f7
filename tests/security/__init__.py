"""Attacks: what others may have prepared or may do while a campaign is computed, and what must hold all the same."""
