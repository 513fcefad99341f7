"""Location, spread and shape of a series of numbers, and whether the shape agrees with a normal distribution.

The omnibus test of D'Agostino and Pearson tests exactly the moments on which the intervals of mean and sigma depend,
skewness and kurtosis. `scipy.stats.normaltest` gives the same numbers, but takes a second to import.
"""

import math

import numpy as np

from reporting.arrays import ROUNDING, Array, sums

# With fewer values the test is not valid (D'Agostino, Belanger, D'Agostino 1990).
FEWEST_FOR_SHAPE = 8
# Normal theory is used only above this p-value, that is if normal values often have moments like these.
LIKELY = 0.2


def location_and_shape(x: Array, ordered: Array | None = None) -> dict[str, float]:
    """Return mean, std (0 if only rounding differs), min, max, median, and, of enough values, skewness and kurtosis.

    `ordered` are the values in ascending order, where somebody has sorted them.
    """
    if x.size == 0:
        return {}
    low, high = float(x.min()), float(x.max())
    median = float(np.median(x)) if ordered is None else float(np.mean(ordered[(x.size - 1) // 2 : x.size // 2 + 1]))
    of_all = sums(x, lambda piece: (piece,))[0] / x.size
    mean = min(max(of_all, low), high)  # by rounding, the mean of equal values can differ from them
    numbers = {"mean": mean, "min": low, "max": high, "median": median}
    if x.size < 2:
        return numbers
    std = math.sqrt(sums(x, lambda piece: (np.square(piece - of_all),))[0] / (x.size - 1))
    if low == high or std <= ROUNDING * max(abs(low), abs(high)):
        return numbers | {"std": 0.0}
    return numbers | {"std": std} | _skewness_and_kurtosis(x, mean, std)


def _skewness_and_kurtosis(x: Array, mean: float, std: float) -> dict[str, float]:
    """Return adjusted skewness G1 and excess kurtosis G2 of values (Joanes and Gill 1998)."""

    def powers(piece: Array) -> tuple[Array, Array]:
        z = (piece - mean) / std
        squares = z * z  # products, because powers above 2 take ten times as long
        return squares * z, squares * squares

    n, numbers = x.size, dict[str, float]()
    third, fourth = sums(x, powers)
    if n > 2:
        numbers["skewness"] = n / ((n - 1) * (n - 2)) * third
    if n > 3:
        fourth *= n * (n + 1) / ((n - 1) * (n - 2) * (n - 3))
        numbers["kurtosis"] = fourth - 3 * (n - 1) ** 2 / ((n - 2) * (n - 3))
    return numbers


def normal_moments_p(z: Array, worth: float) -> float:
    """Return the p-value of skewness and kurtosis if the values are normal; `z` are the values less their mean.

    `worth` is their effective number of independent values, at least 8.
    """
    squares = z * z  # products, because powers above 2 take ten times as long
    square = float(squares.mean())
    return normal_shape_p(
        float((squares * z).mean()) / square**1.5, float((squares * squares).mean()) / square**2, worth
    )


def normal_shape_p(skewness: float, kurtosis: float, worth: float) -> float:
    """Return the p-value of moments of standardised values, the third and the fourth; see `normal_moments_p`."""
    return math.exp(-(_skewness_score(skewness, worth) ** 2 + _kurtosis_score(kurtosis, worth) ** 2) / 2)


def _skewness_score(skewness: float, n: float) -> float:
    """Return the skewness transformed to a standard normal statistic (D'Agostino 1970)."""
    y = skewness * math.sqrt((n + 1) * (n + 3) / (6 * (n - 2)))
    fourth = 3 * (n * n + 27 * n - 70) * (n + 1) * (n + 3) / ((n - 2) * (n + 5) * (n + 7) * (n + 9))
    square = math.sqrt(2 * (fourth - 1)) - 1
    return math.asinh(y / math.sqrt(2 / (square - 1))) / math.sqrt(0.5 * math.log(square))


def _kurtosis_score(kurtosis: float, n: float) -> float:
    """Return the kurtosis transformed to a standard normal statistic (Anscombe and Glynn 1983)."""
    variance = 24 * n * (n - 2) * (n - 3) / ((n + 1) ** 2 * (n + 3) * (n + 5))
    x = (kurtosis - 3 * (n - 1) / (n + 1)) / math.sqrt(variance)
    third = 6 * (n * n - 5 * n + 2) / ((n + 7) * (n + 9)) * math.sqrt(6 * (n + 3) * (n + 5) / (n * (n - 2) * (n - 3)))
    a = 6 + 8 / third * (2 / third + math.sqrt(1 + 4 / third**2))
    ratio = (1 - 2 / a) / (1 + x * math.sqrt(2 / (a - 4)))
    return (1 - 2 / (9 * a) - math.copysign(abs(ratio) ** (1 / 3), ratio)) / math.sqrt(2 / (9 * a))
