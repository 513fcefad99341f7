"""Rare rejects: shares of a few ppm, from the weighted runs of importance sampling."""
