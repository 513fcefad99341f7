"""Geometry of a CAD file in a mechanism file: what it names becomes plain numbers before the mechanism is checked."""
