"""Location, spread and shape of a series of numbers."""

import numpy as np
from numpy.typing import ArrayLike

from reporting.arrays import Array
from reporting.errors import ReportError

# A spread below this share of the largest value is rounding error: the values are a constant. A sum over some thousand
# steps loses about this many of the last bits.
ROUNDING = 1e-12


def series(x: ArrayLike) -> Array:
    """Return `x` as an array of floats, shape (n,); raise ReportError unless it holds a series of numbers."""
    try:
        given = np.asanyarray(x)
        if given.dtype.kind not in "biufO":
            raise TypeError(f"they are of type {given.dtype}")
        if given.dtype.kind == "O" and any(isinstance(value, str | bytes) for value in given.flat):
            raise TypeError("one is a text")
        with np.errstate(over="ignore"):  # an extended float beyond the largest double is infinite and left out
            if isinstance(given, np.ma.MaskedArray):  # a masked value is missing, like one that is not finite
                given = np.ma.filled(given.astype(np.float64), np.nan)
            values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ReportError(f"values are not numbers: {error}") from error
    if values.ndim != 1:
        raise ReportError(f"values have shape {values.shape}: a one-dimensional array of numbers is needed")
    return values


def location_and_shape(x: Array) -> dict[str, float]:
    """Return those of mean, std, min, max, median, skewness and kurtosis that the number of values allows.

    A key is missing where there are too few values. `std` is 0 if the finite values `x` differ by rounding only;
    `skewness` and `kurtosis` are G1 and G2.
    """
    if x.size == 0:
        return {}
    low, high = float(x.min()), float(x.max())
    # By rounding, the mean of equal values can differ from them.
    mean = min(max(float(np.mean(x)), low), high)
    numbers = {"mean": mean, "min": low, "max": high, "median": float(np.median(x))}
    if x.size < 2:
        return numbers
    std = float(np.std(x, ddof=1))
    if low == high or std <= ROUNDING * max(abs(low), abs(high)):
        return numbers | {"std": 0.0}
    return numbers | {"std": std} | _shape((x - mean) / std)


def _shape(z: Array) -> dict[str, float]:
    """Return adjusted skewness G1 and excess kurtosis G2 of standardised values (Joanes and Gill 1998)."""
    n, squares, numbers = z.size, z * z, {}  # products, because powers above 2 take ten times as long
    if n > 2:
        numbers["skewness"] = n / ((n - 1) * (n - 2)) * float(np.sum(squares * z))
    if n > 3:
        fourth = n * (n + 1) / ((n - 1) * (n - 2) * (n - 3)) * float(np.sum(squares * squares))
        numbers["kurtosis"] = fourth - 3 * (n - 1) ** 2 / ((n - 2) * (n - 3))
    return numbers
