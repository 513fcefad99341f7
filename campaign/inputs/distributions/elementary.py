"""Exponential, logarithm, power from element-wise special functions: bits do not depend on the array's length."""

from typing import Any

import numpy as np

from campaign.inputs.distributions.base import Array

LOG2_E = 1.4426950408889634


def exp(x: Any) -> Array:
    """Return e to the ``x``; same shape."""
    from scipy.special import exp2

    return np.asarray(exp2(np.multiply(LOG2_E, x)), dtype=np.float64)


def log(x: Any) -> Array:
    """Return the natural logarithm of ``x`` >= 0, minus infinity at 0; same shape."""
    from scipy.special import xlogy

    return np.asarray(xlogy(1.0, x), dtype=np.float64)


def power(x: Any, exponent: float) -> Array:
    """Return ``x`` >= 0 to a positive exponent; same shape."""
    return exp(exponent * log(x))
