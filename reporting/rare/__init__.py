"""Rare rejects: shares of some ppm, from the weighted runs of importance sampling."""
