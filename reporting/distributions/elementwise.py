"""Functions whose results do not depend, bit for bit, on the length of the array.

They use scipy's special functions, which treat every element alike. NumPy's own ``exp``, ``log`` and ``power`` may use
other instructions for the last elements of an array than for the first ones.
"""

from typing import Any

import numpy as np
from scipy.special import exp2, xlogy

from reporting.arrays import Array

LOG2_E = 1.4426950408889634


def exp(x: Any) -> Array:
    """Return e to the power ``x``; same shape."""
    return np.asarray(exp2(np.multiply(LOG2_E, x)), dtype=np.float64)


def log(x: Any) -> Array:
    """Return the natural logarithm of ``x`` >= 0, minus infinity at 0; same shape."""
    return np.asarray(xlogy(1.0, x), dtype=np.float64)


def power(x: Any, exponent: Any) -> Array:
    """Return ``x`` >= 0 to the power of a positive exponent; the shape of both together."""
    return exp(exponent * log(x))
