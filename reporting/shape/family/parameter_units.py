"""Conversion of a parameter of ``z = (x - shift) / scale`` to the unit of x.

Each function takes the unconstrained parameter, the shift and the scale. The unconstrained form of a positive parameter
is its logarithm.
"""

import math
from collections.abc import Callable

Reading = Callable[[float, float, float], float]


def plain(value: float, shift: float, scale: float) -> float:
    """Return a dimensionless number."""
    return value


def ratio(value: float, shift: float, scale: float) -> float:
    """Return a positive dimensionless number."""
    return math.exp(value)


def place(value: float, shift: float, scale: float) -> float:
    """Return a value of x."""
    return shift + scale * value


def width(value: float, shift: float, scale: float) -> float:
    """Return a width of x."""
    return abs(scale) * math.exp(value)


def of_log(value: float, shift: float, scale: float) -> float:
    """Return the mean of a logarithm."""
    return value + math.log(abs(scale))


def below(value: float, shift: float, scale: float) -> float:
    """Return the end below the values, or for a mirrored family the end above them."""
    return shift - scale * (1.0 + math.exp(value))


def above(value: float, shift: float, scale: float) -> float:
    """Return the end above the values."""
    return shift + scale * (1.0 + math.exp(value))


def probability(value: float, shift: float, scale: float) -> float:
    """Return a share."""
    return 1.0 / (1.0 + math.exp(-value))
