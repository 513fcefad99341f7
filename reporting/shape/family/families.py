"""Families of distributions for a response, simplest first, in terms of shifted and scaled values.

A family maps unconstrained parameters theta to a distribution of ``z = (x - shift) / scale``. Every theta is valid, so
a fit needs no constraints, and the curvature of the likelihood gives the errors. The family determines how shift and
scale are chosen: positive families keep zero at zero, bounded ones put the smallest and largest value at -1 and 1.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from reporting.arrays import Array
from reporting.shape.binned_sample import BinnedSample
from reporting.shape.family import distributions
from reporting.shape.family.distributions import ClosedForm, Parameter

Reading = Callable[[float, float, float], float]
Theta = tuple[float, ...]

# With more degrees of freedom a t distribution is practically normal.
_MOST_FREEDOM = 6.0


# -- a parameter of ``z = (x - shift) / scale`` in the unit of x -------------------------------------------------------
#
# Each function takes the unconstrained parameter, the shift and the scale. The unconstrained form of a positive
# parameter is its logarithm.


def plain(value: float, shift: float, scale: float) -> float:
    """Return a dimensionless number."""
    return value


def ratio(value: float, shift: float, scale: float) -> float:
    """Return a positive dimensionless number."""
    return math.exp(value)


def place(value: float, shift: float, scale: float) -> float:
    """Return a value of x."""
    return shift + scale * value


def width(value: float, shift: float, scale: float) -> float:
    """Return a width of x."""
    return abs(scale) * math.exp(value)


def of_log(value: float, shift: float, scale: float) -> float:
    """Return the mean of a logarithm."""
    return value + math.log(abs(scale))


def below(value: float, shift: float, scale: float) -> float:
    """Return the end below the values, or for a mirrored family the end above them."""
    return shift - scale * (1.0 + math.exp(value))


def above(value: float, shift: float, scale: float) -> float:
    """Return the end above the values."""
    return shift + scale * (1.0 + math.exp(value))


def probability(value: float, shift: float, scale: float) -> float:
    """Return a share."""
    return 1.0 / (1.0 + math.exp(-value))


@dataclass(frozen=True)
class Scaled:
    """The distribution of ``x = shift + scale z``."""

    base: ClosedForm  # of z
    shift: float
    scale: float  # in the unit of x, like the shift; a negative scale mirrors the distribution

    def logpdf(self, x: ArrayLike) -> Array:
        """Return the logarithm of the density [1/unit]."""
        with np.errstate(all="ignore"):
            return np.asarray(self.base.logpdf(self._z(x)) - math.log(abs(self.scale)))

    def cdf(self, x: ArrayLike) -> Array:
        """Return the probability of values up to x."""
        with np.errstate(all="ignore"):
            return np.asarray((self.base.cdf if self.scale > 0 else self.base.sf)(self._z(x)))

    def sf(self, x: ArrayLike) -> Array:
        """Return the probability of values above x, accurate even if it is tiny."""
        with np.errstate(all="ignore"):
            return np.asarray((self.base.sf if self.scale > 0 else self.base.cdf)(self._z(x)))

    def ppf(self, p: ArrayLike) -> Array:
        """Return the quantile of probability p."""
        p = np.asarray(p, dtype=np.float64)
        with np.errstate(all="ignore"):
            return np.asarray(self.shift + self.scale * self.base.ppf(p if self.scale > 0 else 1.0 - p))

    def _z(self, x: ArrayLike) -> Array:
        return (np.asarray(x, dtype=np.float64) - self.shift) / self.scale


@dataclass(frozen=True)
class Family:
    """A family of distributions."""

    name: str  # key in `FAMILIES`
    title: str  # the name in words
    # Functions of (its theta, shift, scale) that return each parameter in the unit of the values, by name and in the
    # order of theta.
    parameters: Mapping[str, Reading]
    # How z is scaled: "free" (median 0, standard deviation 1), "positive" (zero stays zero, median 1), "range" (the
    # values fill -1 to 1), "bounds" (known bounds become 0 and 1), "free mirrored" or "range mirrored".
    frame: str
    # from theta to the distribution of z; arrays of shape (b, 1) instead of numbers give b distributions
    build: Callable[[Sequence[Parameter]], ClosedForm]
    start: Callable[[BinnedSample], Theta]  # from the binned values of z to the theta at which the search starts
    framed: bool = False  # whether the parameters are those of z, so that shift and scale belong to them

    def in_units(self, theta: Theta, shift: float, scale: float) -> dict[str, float]:
        """Return the parameters of ``x = shift + scale z`` by name."""
        readings = zip(self.parameters.items(), theta, strict=True)
        named = {name: float(reading(value, shift, scale)) for (name, reading), value in readings}
        return named | ({"shift": shift, "scale": scale} if self.framed else {})


def _exp(value: Parameter) -> Parameter:
    """Return ``exp(value)``, bounded in case the search diverges."""
    if isinstance(value, float):
        return math.exp(min(max(value, -40.0), 40.0))
    return np.asarray(np.exp(np.clip(value, -40.0, 40.0)))


def _moments(c: BinnedSample) -> Theta:
    """Return the mean and the logarithm of the standard deviation."""
    mean = c.mean(c.values)
    return mean, math.log(math.sqrt(c.mean((c.values - mean) ** 2)))


def _log_moments(c: BinnedSample) -> Theta:
    """Return the mean and the logarithm of the standard deviation of the logarithms."""
    return _moments(replace(c, values=np.log(c.values)))


def _weibull_start(c: BinnedSample) -> Theta:
    """Return parameters from the moments of the logarithms."""
    mean, log_sd = _log_moments(c)  # log x: sd pi / (sqrt(6) shape), mean log scale - 0.5772 / shape
    shape = math.pi / math.sqrt(6) / math.exp(log_sd)
    return math.log(shape), mean + 0.5772 / shape


def _gamma_start(c: BinnedSample) -> Theta:
    """Return parameters from the moments."""
    mean, log_sd = _moments(c)
    variance = math.exp(2 * log_sd)
    return math.log(mean * mean / variance), math.log(variance / mean)


def _root_mean_square(c: BinnedSample) -> Theta:
    """Return the logarithm of the root mean square."""
    return (0.5 * math.log(c.mean(c.values**2)),)


def _logistic_start(c: BinnedSample) -> Theta:
    """Return parameters from the moments."""
    mean, log_sd = _moments(c)
    return mean, log_sd + math.log(math.sqrt(3) / math.pi)


def _laplace_start(c: BinnedSample) -> Theta:
    """Return the median, which is 0, and the logarithm of the mean distance from it: the maximum of the likelihood."""
    return 0.0, math.log(c.mean(np.abs(c.values)))


def _student_start(c: BinnedSample) -> Theta:
    """Return parameters from the moments, with five degrees of freedom."""
    mean, log_sd = _moments(c)
    return mean, log_sd + 0.5 * math.log(0.6), math.log(5.0)  # its variance is 5/3 of the squared scale


def _gumbel_start(c: BinnedSample) -> Theta:
    """Return parameters from the moments."""
    mean, log_sd = _moments(c)
    # Euler's constant 0.5772 is the mean of Gumbel's distribution of mode 0 and scale 1.
    scale = math.exp(log_sd) * math.sqrt(6) / math.pi
    return mean - 0.5772 * scale, math.log(scale)


def _beta_start(c: BinnedSample) -> Theta:
    """Return parameters from the moments."""
    mean, log_sd = _moments(c)
    both = max(mean * (1 - mean) / math.exp(2 * log_sd) - 1, 0.1)
    return math.log(mean * both), math.log((1 - mean) * both)


def _sl_start(c: BinnedSample) -> Theta:
    """Return parameters from the moments of the logarithms above a threshold."""
    # A threshold at -1.5, which is theta = log 0.5: the values fill -1 to 1.
    logs = np.log(c.values + 1.5)
    mean = c.mean(logs)
    return math.log(0.5), mean, 0.5 * math.log(c.mean((logs - mean) ** 2))


def _mixture_start(c: BinnedSample) -> Theta:
    """Return parameters from the moments of the values below and above the mean."""
    mean, log_sd = _moments(c)
    low, high = c.values < mean, c.values >= mean
    means = [float(np.average(c.values[side], weights=c.weights[side])) for side in (low, high)]
    return 0.0, means[0], log_sd - 0.5, means[1], log_sd - 0.5


def _build_sl(t: Sequence[Parameter]) -> ClosedForm:
    return distributions.lognormal(-1.0 - _exp(t[0]), t[1], _exp(t[2]))


_NORMAL = {"mean": place, "sd": width}
_LOGNORMAL = {"mean of log": of_log, "sd of log": ratio}
_SHAPE_AND_SCALE = {"shape": ratio, "scale": width}
_MODE_AND_SCALE = {"mode": place, "scale": width}
_POWER = {"lambda": plain, "mean": plain, "sd": ratio}

FAMILIES = {
    family.name: family
    for family in (
        Family("normal", "normal", _NORMAL, "free", lambda t: distributions.normal(t[0], _exp(t[1])), _moments),
        Family(
            "lognormal", "lognormal", _LOGNORMAL, "positive",
            lambda t: distributions.lognormal(0.0, t[0], _exp(t[1])), _log_moments,
        ),
        Family(
            "weibull", "Weibull", _SHAPE_AND_SCALE, "positive",
            lambda t: distributions.weibull(_exp(t[0]), _exp(t[1])), _weibull_start,
        ),
        Family(
            "gamma", "gamma", _SHAPE_AND_SCALE, "positive",
            lambda t: distributions.gamma(_exp(t[0]), _exp(t[1])), _gamma_start,
        ),
        Family(
            "half_normal", "half-normal", {"sd": width}, "positive",
            lambda t: distributions.folded_normal(0.0, _exp(t[0])), _root_mean_square,
        ),
        Family(
            "folded_normal", "folded normal", _NORMAL, "positive",
            lambda t: distributions.folded_normal(t[0], _exp(t[1])), _moments,
        ),
        Family(
            "logistic", "logistic", {"mean": place, "scale": width}, "free",
            lambda t: distributions.logistic(t[0], _exp(t[1])), _logistic_start,
        ),
        Family(
            "laplace", "Laplace", {"median": place, "scale": width}, "free",
            lambda t: distributions.laplace(t[0], _exp(t[1])), _laplace_start,
        ),
        Family(
            "largest_extreme", "largest extreme value", _MODE_AND_SCALE, "free",
            lambda t: distributions.largest_extreme(t[0], _exp(t[1])), _gumbel_start,
        ),
        Family(
            "smallest_extreme", "smallest extreme value", _MODE_AND_SCALE, "free mirrored",
            lambda t: distributions.largest_extreme(t[0], _exp(t[1])), _gumbel_start,
        ),
        Family(
            "beta", "beta on the known bounds", {"a": ratio, "b": ratio}, "bounds",
            lambda t: distributions.beta(_exp(t[0]), _exp(t[1])), _beta_start, framed=True,
        ),
        Family(
            "student_t", "Student t", {"mean": place, "scale": width, "degrees of freedom": ratio}, "free",
            lambda t: distributions.student_t(t[0], _exp(t[1]), _exp(np.minimum(t[2], _MOST_FREEDOM))), _student_start,
        ),
        Family(
            "box_cox", "normal after Box-Cox", _POWER, "positive",
            lambda t: distributions.box_cox_normal(t[0], t[1], _exp(t[2])), lambda c: (0.0, *_log_moments(c)),
            framed=True,
        ),
        Family(
            "yeo_johnson", "normal after Yeo-Johnson", _POWER, "free",
            lambda t: distributions.yeo_johnson_normal(t[0], t[1], _exp(t[2])), lambda c: (1.0, *_moments(c)),
            framed=True,
        ),
        Family(
            "johnson_sl", "Johnson SL, lognormal above a threshold", {"low": below} | _LOGNORMAL, "range",
            _build_sl, _sl_start,
        ),
        Family(
            "johnson_sl_mirrored", "Johnson SL, lognormal below a threshold", {"high": below} | _LOGNORMAL,
            "range mirrored", _build_sl, _sl_start,
        ),
        Family(
            "johnson_su", "Johnson SU", {"gamma": plain, "delta": ratio, "xi": place, "lambda": width}, "free",
            lambda t: distributions.johnson_su(t[0], _exp(t[1]), t[2], _exp(t[3])), lambda _: (0.0, 0.7, 0.0, 0.7),
        ),
        Family(
            "johnson_sb", "Johnson SB", {"gamma": plain, "delta": ratio, "low": below, "high": above}, "range",
            lambda t: distributions.johnson_sb(t[0], _exp(t[1]), -1.0 - _exp(t[2]), 1.0 + _exp(t[3])),
            lambda _: (0.0, 0.0, -1.0, -1.0),
        ),
        Family(
            "two_normals", "mixture of two normals",
            {"share 1": probability, "mean 1": place, "sd 1": width, "mean 2": place, "sd 2": width}, "free",
            lambda t: distributions.two_normals(1 / (1 + _exp(-t[0])), t[1], _exp(t[2]), t[3], _exp(t[4])),
            _mixture_start,
        ),
    )
}  # fmt: skip
