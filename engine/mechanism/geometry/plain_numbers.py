"""Numbers as a file has them: rounded where only the arithmetic of one machine would differ from another's."""

from math import log10

import numpy as np

from engine.arrays import Array

DECIMALS = 12
"""Of a length in mm and of a component of a direction; as many significant digits of masses and inertias."""


def length(value: float, millimetre: float) -> float:
    """Return a length rounded to 1e-12 mm; ``millimetre`` is a millimetre in its unit."""
    return round(float(value), DECIMALS - round(log10(millimetre))) + 0.0


def lengths(values: Array, millimetre: float) -> list[float]:
    """Return lengths, shape (n,), rounded to 1e-12 mm; no zero is negative."""
    return [length(value, millimetre) for value in values]


def direction(values: Array) -> list[float]:
    """Return the components of a unit vector."""
    return [round(float(value), DECIMALS) + 0.0 for value in values]


def significant(values: Array) -> Array:
    """Return numbers of one quantity, of any shape, with as many digits as the largest of them needs."""
    largest = float(np.abs(values).max())
    decimals = DECIMALS - 1 - int(np.floor(log10(largest))) if largest > 0 else 0
    return np.round(values, decimals) + 0.0
