"""Shapes of responses, and what is true of them.

Every response is ``value(w)``, a function of a standard normal score w that never falls, so a share below a value is a
normal probability, and moments are integrals over scores.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.interpolate import PchipInterpolator

from engine.arrays import Array

_SCORES = np.linspace(-13.0, 13.0, 5201)
_DENSITY = stats.norm.pdf(_SCORES) * (_SCORES[1] - _SCORES[0])
_FAR = 13.0  # no share beyond such a score

Curve = Callable[[Array], Array]


def _of(distribution: stats.rv_continuous) -> Curve:
    """Return the function from normal scores to values of a distribution, computed from the nearer tail."""

    def value(score: Array) -> Array:
        lower = score < 0
        found = np.empty_like(score)
        found[lower] = distribution.ppf(stats.norm.cdf(score[lower]))
        found[~lower] = distribution.isf(stats.norm.sf(score[~lower]))
        return found

    return value


def _mixture(*parts: tuple[float, float, float]) -> Curve:
    """Return the function from scores to values of normal distributions, each with its share, mean and sigma."""
    share, mean, std = (np.array(column) for column in zip(*parts, strict=True))
    x = np.linspace(np.min(mean - 14 * std), np.max(mean + 14 * std), 8001)
    z = (x[:, None] - mean) / std
    below, above = stats.norm.cdf(z) @ share, stats.norm.sf(z) @ share
    # From the nearer tail: shares near 1 have no digits left for the other one.
    scores = np.where(below < 0.5, stats.norm.ppf(below), stats.norm.isf(above))
    interpolated = PchipInterpolator(scores, x)
    return lambda w: np.asarray(interpolated(w))


def _folded(score: Array) -> Array:
    """Return values of a normal distribution of mean 1 and sigma 1 without their signs."""
    return np.sqrt(_of(stats.ncx2(1, 1))(score))


def _rounded(step: float) -> Curve:
    """Return the curve of a normal distribution whose values are rounded to multiples of a step."""
    return lambda w: step * np.floor(w / step + 0.5)


CURVES: dict[str, Curve] = {
    "normal": lambda w: w,
    "lognormal": lambda w: np.exp(0.5 * w),
    "gamma": _of(stats.gamma(16)),
    "t5": _of(stats.t(5)),
    "uniform": _of(stats.uniform()),
    # two normal distributions, 4 sigmas apart
    "bimodal": _mixture((0.5, -2.0, 1.0), (0.5, 2.0, 1.0)),
    "0.3 % five times as wide": _mixture((0.997, 0.0, 1.0), (0.003, 0.0, 5.0)),
    "1 % five times as wide": _mixture((0.99, 0.0, 1.0), (0.01, 0.0, 5.0)),
    "normal cut at 2 sigmas": _of(stats.truncnorm(-2, 2)),
    "Gumbel": _of(stats.gumbel_r()),
    "t3": _of(stats.t(3)),
    "Weibull, shape 0.9": _of(stats.weibull_min(0.9)),
    "Weibull, shape 1.5": _of(stats.weibull_min(1.5)),
    "Weibull, shape 3.6": _of(stats.weibull_min(3.6)),
    "skew normal, 5": _of(stats.skewnorm(5)),
    "normal cut at its mean": _of(stats.halfnorm()),
    "folded normal": _folded,
    "Rayleigh": _of(stats.rayleigh()),
    "exponential": _of(stats.expon()),
    "Laplace": _of(stats.laplace()),
    "t4": _of(stats.t(4)),
    "t8": _of(stats.t(8)),
    "logistic": _of(stats.logistic()),
    "triangular": _of(stats.triang(0.5)),
    "triangular, mode at 0.1": _of(stats.triang(0.1)),
    "arcsine": _of(stats.arcsine()),
    "beta (2, 5)": _of(stats.beta(2, 5)),
    "lognormal (1)": lambda w: np.exp(w),
    "gamma (2)": _of(stats.gamma(2)),
    "gamma (100)": _of(stats.gamma(100)),
    "1 % shifted by 6 sigmas": _mixture((0.99, 0.0, 1.0), (0.01, 6.0, 1.0)),
    "0.2 % shifted by 8 sigmas": _mixture((0.998, 0.0, 1.0), (0.002, 8.0, 1.0)),
    "two normals 2 sigmas apart": _mixture((0.5, -1.0, 1.0), (0.5, 1.0, 1.0)),
    "20 % shifted by 3 sigmas": _mixture((0.8, 0.0, 1.0), (0.2, 3.0, 1.0)),
    "a tenth at a stop": lambda w: np.maximum(w, stats.norm.ppf(0.1)),
    "rounded to half a sigma": _rounded(0.5),
    "rounded to a sigma": _rounded(1.0),
    "5 % shifted by 3 sigmas": _mixture((0.95, 0.0, 1.0), (0.05, 3.0, 1.0)),
}
# Of these some value has a share of its own, so that a limit may lie on it.
_STEPPED = ("a tenth at a stop", "rounded to half a sigma", "rounded to a sigma")


@dataclass(frozen=True)
class Truth:
    """True values of a production whose score has any sigma."""

    mean: float
    std: float
    median: float
    low: float  # quantile at 0.135 %
    high: float  # quantile at 99.865 %
    below: float  # share out of limits [ppm]
    above: float  # share out of limits [ppm]
    lsl: float
    usl: float
    target: float

    @property
    def cpl(self) -> float:
        """Lower index."""
        return (self.mean - self.lsl) / (3 * self.std)

    @property
    def cpu(self) -> float:
        """Upper index."""
        return (self.usl - self.mean) / (3 * self.std)

    @property
    def cpk(self) -> float:
        """Smaller one of `cpl` and `cpu`."""
        return min(self.cpl, self.cpu)

    @property
    def cp(self) -> float:
        """Potential index."""
        return (self.usl - self.lsl) / (6 * self.std)

    @property
    def ppm(self) -> float:
        """Share out of limits on both sides."""
        return self.below + self.above


# Limits as scores: 233 ppm below, 1,350 ppm above.
LIMITS = (-3.5, 3.0)


@lru_cache(maxsize=256)
def moments(shape: str, spread: float = 1.0) -> tuple[float, float]:
    """Return mean and sigma of a shape whose score has a sigma of ``spread``."""
    values = CURVES[shape](spread * _SCORES)
    mean = float(values @ _DENSITY)
    return mean, float(np.sqrt((values - mean) ** 2 @ _DENSITY))


@lru_cache(maxsize=256)
def truth(shape: str, spread: float = 1.0, limits: tuple[float, float] = LIMITS) -> Truth:
    """Return the true values of a shape whose score has a sigma of ``spread``, with limits at scores of sigma 1."""
    mean, std = moments(shape, spread)
    usual_mean, usual_std = moments(shape)
    lsl, low, median, high, usl = CURVES[shape](np.array([limits[0], -3.0 * spread, 0.0, 3.0 * spread, limits[1]]))
    below, above = _beyond(shape, limits, float(lsl), float(usl))
    return Truth(
        mean=mean,
        std=std,
        median=float(median),
        low=float(low),
        high=float(high),
        below=1e6 * float(stats.norm.cdf(below / spread)),
        above=1e6 * float(stats.norm.sf(above / spread)),
        lsl=float(lsl),
        usl=float(usl),
        target=usual_mean + 0.3 * usual_std,
    )


def share_within(shape: str, low: float, high: float) -> float:
    """Return the share of a shape's values from one value to another, both included."""
    values = CURVES[shape](_SCORES)
    # Of equal values `interp` takes the last, and the first if all are mirrored.
    last = np.interp(high, values, _SCORES, -np.inf, np.inf)
    first = -np.interp(-low, -values[::-1], -_SCORES[::-1], -np.inf, np.inf)
    return float(stats.norm.cdf(last) - stats.norm.cdf(first))


def _beyond(shape: str, limits: tuple[float, float], lsl: float, usl: float) -> tuple[float, float]:
    """Return the scores beyond which values are beyond the limits, whose own scores are given."""
    if shape not in _STEPPED:
        return limits
    curve = CURVES[shape]
    return _edge(lambda w: curve(w) < lsl, -_FAR, 0.0), -_edge(lambda w: curve(-w) > usl, -_FAR, 0.0)


def _edge(beyond: Callable[[Array], NDArray[np.bool_]], inside: float, outside: float) -> float:
    """Return where a condition of a score that holds at most up to there ends; -infinity where it never holds."""
    low, high = inside, outside
    if not beyond(np.array([low]))[0]:
        return -np.inf
    while high - low > 1e-12:
        middle = (low + high) / 2
        low, high = (middle, high) if beyond(np.array([middle]))[0] else (low, middle)
    return low


@lru_cache(maxsize=64)
def explained(shape: str, share: float) -> float:
    """Return the share of a shape's variance explained by a part of its score with the share `share` of variance."""
    _, std = moments(shape)
    # Coarser, because the integral is over pairs of scores.
    scores, density = _SCORES[::10], 10 * _DENSITY[::10]
    both = np.sqrt(share) * scores[:, None] + np.sqrt(1 - share) * scores[None, :]
    expected = CURVES[shape](both.ravel()).reshape(both.shape) @ density
    mean = float(expected @ density)
    return float((expected - mean) ** 2 @ density) / std**2


@lru_cache(maxsize=16)
def distance_from_normal(shape: str) -> float:
    """Return the largest difference between the cumulative distributions of a shape and of a normal distribution."""
    mean, std = moments(shape)
    differences = stats.norm.cdf(_SCORES) - stats.norm.cdf((CURVES[shape](_SCORES) - mean) / std)
    return float(np.abs(differences).max())
