"""Numbers for a mechanism file, rounded so that differences in the arithmetic of machines do not show."""

from math import log10

import numpy as np

from engine.arrays import Array

DECIMALS = 12
"""Decimals of a length in mm and of a component of a direction; significant digits of masses and inertias."""


def length(value: float, millimetre: float) -> float:
    """Return a length rounded to 1e-12 mm; ``millimetre`` is the length of a millimetre in its unit."""
    return round(float(value), DECIMALS - round(log10(millimetre))) + 0.0


def lengths(values: Array, millimetre: float) -> list[float]:
    """Return lengths, shape (n,), rounded to 1e-12 mm, without negative zeros."""
    return [length(value, millimetre) for value in values]


def direction(values: Array) -> list[float]:
    """Return the rounded components of a unit vector."""
    return [round(float(value), DECIMALS) + 0.0 for value in values]


def significant(values: Array) -> Array:
    """Return numbers of one quantity, of any shape, rounded to the decimals that the largest of them needs."""
    largest = float(np.abs(values).max())
    decimals = DECIMALS - 1 - int(np.floor(log10(largest))) if largest > 0 else 0
    return np.round(values, decimals) + 0.0
