"""Notify other systems when a campaign ends, or when a Cpk is too small."""
