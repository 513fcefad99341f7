"""The omnibus test of D'Agostino and Pearson: whether skewness and kurtosis agree with a normal distribution.

It tests exactly the moments on which the intervals of mean and sigma depend. `scipy.stats.normaltest` gives the same
numbers, but takes a second to import.
"""

import math

from reporting.arrays import Array

# With fewer values the test is not valid (D'Agostino, Belanger, D'Agostino 1990).
FEWEST_FOR_SHAPE = 8
# Normal theory is used only above this p-value, that is if normal values often have moments like these.
LIKELY = 0.2


def normal_moments_p(z: Array, worth: float) -> float:
    """Return the p-value of skewness and kurtosis under the hypothesis that the values are normal.

    `z`, shape (n,), holds the values minus their mean, not all 0; `worth` is the effective number of independent
    values, at least 8.
    """
    squares = z * z  # products, because powers above 2 take ten times as long
    square = float(squares.mean())
    skewness, kurtosis = float((squares * z).mean()) / square**1.5, float((squares * squares).mean()) / square**2
    return math.exp(-(_of_skewness(skewness, worth) ** 2 + _of_kurtosis(kurtosis, worth) ** 2) / 2)


def _of_skewness(skewness: float, n: float) -> float:
    """Return the skewness transformed to a standard normal statistic (D'Agostino 1970)."""
    y = skewness * math.sqrt((n + 1) * (n + 3) / (6 * (n - 2)))
    fourth = 3 * (n * n + 27 * n - 70) * (n + 1) * (n + 3) / ((n - 2) * (n + 5) * (n + 7) * (n + 9))
    square = math.sqrt(2 * (fourth - 1)) - 1
    return math.asinh(y / math.sqrt(2 / (square - 1))) / math.sqrt(0.5 * math.log(square))


def _of_kurtosis(kurtosis: float, n: float) -> float:
    """Return the kurtosis transformed to a standard normal statistic (Anscombe and Glynn 1983)."""
    variance = 24 * n * (n - 2) * (n - 3) / ((n + 1) ** 2 * (n + 3) * (n + 5))
    x = (kurtosis - 3 * (n - 1) / (n + 1)) / math.sqrt(variance)
    third = 6 * (n * n - 5 * n + 2) / ((n + 7) * (n + 9)) * math.sqrt(6 * (n + 3) * (n + 5) / (n * (n - 2) * (n - 3)))
    a = 6 + 8 / third * (2 / third + math.sqrt(1 + 4 / third**2))
    ratio = (1 - 2 / a) / (1 + x * math.sqrt(2 / (a - 4)))
    return (1 - 2 / (9 * a) - math.copysign(abs(ratio) ** (1 / 3), ratio)) / math.sqrt(2 / (9 * a))
