"""Geometry of a CAD file in a mechanism file: named features become plain numbers before the mechanism is checked."""
