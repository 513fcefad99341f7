"""Location, spread and shape of a series of numbers."""

import numpy as np
from numpy.typing import ArrayLike

from reporting.arrays import Array
from reporting.errors import ReportError

# A spread below this share of the largest value is the rounding of a constant, not a spread.
ROUNDING = 8 * float(np.finfo(np.float64).eps)


def series(x: ArrayLike) -> Array:
    """Return `x` as a one-dimensional array of floats.

    Raises
    ------
    ReportError
        It is not numbers, or not one series of them.
    """
    try:
        values = np.asarray(x, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ReportError(f"values are not numbers: {error}") from error
    if values.ndim != 1:
        raise ReportError(f"values have shape {values.shape}: one series of numbers is needed")
    return values


def location_and_shape(x: Array) -> dict[str, float]:
    """Return location, spread and shape as far as the number of values allows.

    The keys mean, std, min, max, median are in the unit of `x`; std is 0 where the values differ by rounding only.
    skewness and kurtosis are G1 and G2. A key is missing where there are too few values.

    Parameters
    ----------
    x : array, shape (n,)
        Finite values.
    """
    if x.size == 0:
        return {}
    low, high = float(x.min()), float(x.max())
    # The mean of equal values may round to a neighbour of them; it still lies between its extremes.
    mean = min(max(float(np.mean(x)), low), high)
    numbers = {"mean": mean, "min": low, "max": high, "median": float(np.median(x))}
    if x.size < 2:
        return numbers
    std = float(np.std(x, ddof=1))
    if low == high or std <= ROUNDING * max(abs(low), abs(high)):
        return numbers | {"std": 0.0}
    return numbers | {"std": std} | _shape((x - mean) / std)


def _shape(z: Array) -> dict[str, float]:
    """Return adjusted skewness and excess kurtosis of standardised values (Joanes, Gill 1998: G1, G2)."""
    n, numbers = z.size, {}
    if n > 2:
        numbers["skewness"] = n / ((n - 1) * (n - 2)) * float(np.sum(z**3))
    if n > 3:
        third = n * (n + 1) / ((n - 1) * (n - 2) * (n - 3)) * float(np.sum(z**4))
        numbers["kurtosis"] = third - 3 * (n - 1) ** 2 / ((n - 2) * (n - 3))
    return numbers
