"""Exponential, logarithm and power whose bits do not depend on the array's length.

They are made of scipy's special functions, which treat every element alike. NumPy's own ``exp``, ``log`` and ``power``
may treat the last elements of an array by other instructions than the first ones.
"""

from typing import Any

import numpy as np
from scipy.special import exp2, xlogy

from engine.arrays import Array

LOG2_E = 1.4426950408889634
HALF_LOG_TWO_PI = 0.9189385332046728


def exp(x: Any) -> Array:
    """Return e to the ``x``; same shape."""
    return np.asarray(exp2(np.multiply(LOG2_E, x)), dtype=np.float64)


def log(x: Any) -> Array:
    """Return the natural logarithm of ``x`` >= 0, minus infinity at 0; same shape."""
    return np.asarray(xlogy(1.0, x), dtype=np.float64)


def power(x: Any, exponent: float) -> Array:
    """Return ``x`` >= 0 to a positive exponent; same shape."""
    return exp(exponent * log(x))
