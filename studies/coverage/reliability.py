"""Limit states of the reliability literature, whose probabilities of failure are known.

RP: problems of TNO's benchmark of reliability methods (Rózsás, Slobbe 2019), as far as they are explicit functions of
independent variables; the others are of Waarts (2000) and of textbooks. The shares are ours: they follow from one
integral, or from one conditional probability averaged over evenly spread points (the tests have each), because some of
the published ones have two digits.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from reporting.arrays import Array

Margin = Callable[[Array], Array]  # of the variables, shape (d, n): below 0 where the structure fails


@dataclass(frozen=True)
class LimitState:
    """A response of standard scores, shape (n, d), and the limit beyond which a known share lies."""

    dimensions: int
    share: float
    response: Callable[[Array], Array]
    limit: float


def lognormal(mean: float, std: float) -> stats.rv_continuous:
    """Return the lognormal distribution of this mean and standard deviation."""
    spread = np.sqrt(np.log1p((std / mean) ** 2))
    return stats.lognorm(spread, scale=mean * np.exp(-(spread**2) / 2))


def gumbel(mean: float, std: float) -> stats.rv_continuous:
    """Return the distribution of largest values of this mean and standard deviation."""
    scale = std * np.sqrt(6) / np.pi
    return stats.gumbel_r(mean - np.euler_gamma * scale, scale)


def _normals(*of: tuple[float, float]) -> tuple[stats.rv_continuous, ...]:
    return tuple(stats.norm(mean, std) for mean, std in of)


def _two_planes(x: Array) -> Array:
    return np.asarray(np.minimum(3 * np.sqrt(3) - x[0] - x[1] - x[2], 3 - x[2]))


def _sandwich(x: Array) -> Array:
    a, b, c, d, e, f, g = x
    bending = d**2 - 4 * e * f * g**2 + d * (f + 4 * e + 2 * f * g)
    return np.asarray(155_900 - a * b**3 / (2 * c**3) * bending / (d * e * (d + f + 2 * f * g)))


def _strips(x: Array) -> Array:
    d = x[0] - x[1]
    near = 0.2 + 0.6 * d**4 - np.abs(d) / np.sqrt(2)
    return np.asarray(np.minimum(near, 5 / np.sqrt(2) - 2.2 - np.abs(d)))


def _island_and_wedge(x: Array) -> Array:
    wedge = np.maximum(3 - x[0] ** 2 + x[1] ** 3, 2 - x[0] - 8 * x[1])
    return np.asarray(np.minimum(wedge, (x[0] + 3) ** 2 + (x[1] + 3) ** 2 - 4))


def _paths(x: Array) -> Array:
    halved = np.min(x[1:4], axis=0) - x[4] / 2
    whole = np.maximum(x[3], np.minimum(x[1], x[2])) - x[4]
    return np.asarray(np.minimum(x[0] - x[4], np.maximum(halved, whole)))


def _pressure(x: Array) -> Array:
    a, b, c, d, e = x
    first = 0.847 + 0.96 * b + 0.986 * c - 0.216 * d + 0.077 * b**2 + 0.11 * c**2 + 7 / 378 * d**2
    first -= c * b + 0.106 * b * d + 0.11 * c * d
    second = 84_000 * a / np.sqrt(c**2 + d**2 - c * d + 3 * e**2) - 1
    return np.asarray(np.minimum(np.minimum(first, second), 84_000 * a / np.abs(d) - 1))


def _two_jumps(x: Array) -> Array:
    first = np.where(x[0] <= 3.5, 0.85 - 0.1 * x[0], 4 - x[0])
    return np.asarray(np.minimum(first, np.where(x[1] <= 2, 2.3 - x[1], 0.5 - 0.1 * x[1])))


def _four_branches(x: Array) -> Array:
    curved = 3 + 0.1 * (x[0] - x[1]) ** 2 - np.abs(x[0] + x[1]) / np.sqrt(2)
    return np.asarray(np.minimum(curved, 7 / np.sqrt(2) - np.abs(x[0] - x[1])))


_TWO = _normals((0, 1), (0, 1))
_RESISTANCES = (lognormal(2200, 220), lognormal(2100, 210), lognormal(2300, 230), lognormal(2000, 200))
_SANDWICH = ((350, 35), (50.8, 5.08), (3.81, 0.381), (173, 17.3), (9.38, 0.938), (33.1, 3.31), (0.036, 0.0036))
_PRESSURE = ((0.07433, 0.005), (0.1, 0.01), (13, 60), (4751, 48), (-684, 11))
# By name: the share that fails [ppm], the variables, and the margin.
PROBLEMS: dict[str, tuple[float, tuple[stats.rv_continuous, ...], Margin]] = {
    "RP8": (
        789.79,
        (*(lognormal(120, 12) for _ in range(4)), lognormal(50, 10), lognormal(40, 8)),
        lambda x: x[0] + 2 * x[1] + 2 * x[2] + x[3] - 5 * x[4] - 5 * x[5],
    ),
    "RP14": (
        772.6,
        (stats.uniform(70, 10), stats.norm(39, 0.1), gumbel(1500, 350), *_normals((400, 0.1), (250_000, 35_000))),
        lambda x: x[0] - 32 / (np.pi * x[1] ** 3) * np.sqrt((x[2] * x[3]) ** 2 / 16 + x[4] ** 2),
    ),
    "RP22": (4207.31, _TWO, lambda x: 2.5 - (x[0] + x[1]) / np.sqrt(2) + 0.1 * (x[0] - x[1]) ** 2),
    "RP24": (
        2860.0,
        _normals((10, 3), (10, 3)),
        lambda x: 2.5 - 0.2357 * (x[0] - x[1]) + 0.00463 * (x[0] + x[1] - 20) ** 4,
    ),
    "RP25": (41.486, _TWO, lambda x: np.maximum(x[0] ** 2 - 8 * x[1] + 16, 32 - 16 * x[0] + x[1])),
    "RP28": (0.14533, _normals((78_064, 11_710), (0.0104, 0.00156)), lambda x: x[0] * x[1] - 146.14),
    "RP31": (3226.68, _TWO, lambda x: 2 - x[1] + 256 * x[0] ** 4),
    "RP33": (2575.6, _normals(*3 * ((0, 1),)), _two_planes),
    "RP35": (
        3478.95,
        _TWO,
        lambda x: np.minimum(2 - x[1] + np.exp(-0.1 * x[0] ** 2) + (0.2 * x[0]) ** 4, 4.5 - x[0] * x[1]),
    ),
    "RP38": (8050.0, _normals(*_SANDWICH), _sandwich),
    "RP53": (
        31_320.5,
        _normals((1.5, 1), (2.5, 1)),
        lambda x: np.sin(2.5 * x[0]) + 2 - (x[0] ** 2 + 4) * (x[1] - 1) / 20,
    ),
    "RP54": (990.6, 20 * (stats.expon(),), lambda x: np.sum(x, axis=0) - 8.951),
    "RP55": (560_014.0, 2 * (stats.uniform(-1, 2),), _strips),
    "RP57": (28_237.5, _TWO, _island_and_wedge),
    "RP60": (44_840.0, (*_RESISTANCES, lognormal(1200, 480)), _paths),
    "RP63": (376.94, 100 * (stats.norm(),), lambda x: 0.1 * np.sum(x[1:] ** 2, axis=0) - x[0] - 4.5),
    "RP75": (9819.3, _TWO, lambda x: 3 - x[0] * x[1]),
    "RP77": (
        0.26908,
        _normals((10, 0.5), (0, 1), (4, 1)),
        lambda x: np.where(x[2] <= 5, x[0] - x[1] - x[2], x[2] - x[1]),
    ),
    "RP89": (5471.3, _TWO, lambda x: np.minimum(8 - x[0] ** 2 - x[1], 6 - x[0] / 5 - x[1])),
    "RP91": (700.25, _normals(*_PRESSURE), _pressure),
    "RP107": (0.28665, 10 * (stats.norm(),), lambda x: 5 * np.sqrt(10) - np.sum(x, axis=0)),
    "RP110": (31.958, _TWO, _two_jumps),
    "RP111": (0.80351, _TWO, lambda x: 12.5 - np.abs(x[0] * x[1])),
    "four branches": (2222.8, _TWO, _four_branches),
    "R - S": (78_649.6, _normals((4, 1), (2, 1)), lambda x: x[0] - x[1]),
    "beam in tension": (
        29_198.2,
        (lognormal(300, 30), stats.norm(75_000, 5000)),
        lambda x: x[0] - x[1] / (100 * np.pi),
    ),
}


def limit_state(name: str) -> LimitState:
    """Return a problem as a response of standard scores, which fails above 0."""
    ppm, variables, margin = PROBLEMS[name]

    def response(z: Array) -> Array:
        # From the nearer tail: shares near 1 have no digits left for the other one.
        below, above = stats.norm.cdf(-np.abs(z)), z > 0
        x = [np.where(a, v.isf(p), v.ppf(p)) for v, p, a in zip(variables, below.T, above.T, strict=True)]
        return np.asarray(-margin(np.array(x)))

    return LimitState(len(variables), 1e-6 * ppm, response, 0.0)
