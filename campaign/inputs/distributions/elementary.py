"""Exponential, logarithm and power whose results do not depend, bit for bit, on the array's length.

They use scipy's special functions, which treat every element alike. NumPy's own ``exp``, ``log`` and ``power`` may use
other instructions for the last elements of an array than for the first ones.
"""

from typing import Any

import numpy as np
from scipy.special import exp2, xlogy

from engine.arrays import Array

LOG2_E = 1.4426950408889634
HALF_LOG_TWO_PI = 0.9189385332046728


def exp(x: Any) -> Array:
    """Return e to the power ``x``; same shape."""
    return np.asarray(exp2(np.multiply(LOG2_E, x)), dtype=np.float64)


def log(x: Any) -> Array:
    """Return the natural logarithm of ``x`` >= 0, minus infinity at 0; same shape."""
    return np.asarray(xlogy(1.0, x), dtype=np.float64)


def power(x: Any, exponent: float) -> Array:
    """Return ``x`` >= 0 to the power of a positive exponent; same shape."""
    return exp(exponent * log(x))
