"""Families of distributions for a response, simplest first, in terms of shifted and scaled values.

A family maps unconstrained parameters theta to a distribution of ``z = (x - shift) / scale``. Every theta is valid, so
a fit needs no constraints, and the curvature of the likelihood gives the errors. The family determines how shift and
scale are chosen: positive families keep zero at zero, bounded ones put the smallest and largest value at -1 and 1.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from reporting.arrays import Array
from reporting.distributions import forms
from reporting.distributions.forms import ClosedForm, Parameter

Theta = tuple[float, ...]
Start = Callable[[Array, Array], Theta]  # of values of z and the weight of each

# With more degrees of freedom a t distribution is practically normal.
_MOST_FREEDOM = 6.0


def _exp(value: Parameter) -> Parameter:
    """Return ``exp(value)``, bounded in case the search diverges."""
    if isinstance(value, float):
        return math.exp(min(max(value, -40.0), 40.0))
    return np.asarray(np.exp(np.clip(value, -40.0, 40.0)))


def _same(value: Parameter) -> Parameter:
    return value


def _place(value: float, shift: float, scale: float) -> float:
    return shift + scale * value


@dataclass(frozen=True)
class Kind:
    """What a parameter is: how it follows from an unconstrained number, and what it is in the unit of the values."""

    of_theta: Callable[[Parameter], Parameter]  # from the unconstrained number to the parameter of z
    in_units: Callable[[float, float, float], float] = lambda value, *_: value  # from it, shift and scale to that of x


PLAIN = Kind(_same)  # a dimensionless number
RATIO = Kind(_exp)  # a positive one
SHARE = Kind(lambda t: 1.0 / (1.0 + _exp(-t)))
FREEDOM = Kind(lambda t: _exp(np.minimum(t, _MOST_FREEDOM)))
PLACE = Kind(_same, _place)  # a value of x
WIDTH = Kind(_exp, lambda value, _, scale: abs(scale) * value)
OF_LOG = Kind(_same, lambda value, _, scale: value + math.log(abs(scale)))  # mean of a logarithm
# the end below the values, which fill -1 to 1, or for a mirrored family the end above them; and the end above
BELOW = Kind(lambda t: -1.0 - _exp(t), _place)
ABOVE = Kind(lambda t: 1.0 + _exp(t), _place)


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
            return np.asarray(self.shift + self.scale * (self.base.ppf if self.scale > 0 else self.base.isf)(p))

    def _z(self, x: ArrayLike) -> Array:
        return (np.asarray(x, dtype=np.float64) - self.shift) / self.scale


@dataclass(frozen=True)
class Family:
    """A family of distributions."""

    name: str  # key in `FAMILIES`
    title: str  # the name in words
    parameters: Mapping[str, Kind]  # by name, in the order of theta and of the arguments of `form`
    # How z is scaled: "free" (median 0, standard deviation 1), "positive" (zero stays zero, median 1), "range" (the
    # values fill -1 to 1), "skewed" (the same, for values skewed upwards), "free mirrored" or "skewed mirrored".
    frame: str
    form: Callable[..., ClosedForm]
    start: Start  # theta at which the search starts
    framed: bool = False  # whether the parameters are those of z, so that shift and scale belong to them

    def build(self, theta: Sequence[Parameter]) -> ClosedForm:
        """Return the distribution of z; arrays of shape (b, 1) instead of numbers give b distributions."""
        return self.form(*(kind.of_theta(t) for kind, t in zip(self.parameters.values(), theta, strict=True)))

    def in_units(self, theta: Theta, shift: float, scale: float) -> dict[str, float]:
        """Return the parameters of ``x = shift + scale z`` by name."""
        named = {
            name: float(kind.in_units(float(kind.of_theta(value)), shift, scale))
            for (name, kind), value in zip(self.parameters.items(), theta, strict=True)
        }
        return named | ({"shift": shift, "scale": scale} if self.framed else {})


# -- where the search starts -------------------------------------------------------------------------------------------


def _mean(z: Array, weights: Array) -> float:
    return float(weights @ z) / float(np.sum(weights))


def _moments(z: Array, weights: Array) -> Theta:
    """Return the mean and the logarithm of the standard deviation."""
    mean = _mean(z, weights)
    return mean, 0.5 * math.log(_mean((z - mean) ** 2, weights))


def _of_moments(of: Callable[[float, float], Theta]) -> Start:

    def start(z: Array, weights: Array) -> Theta:
        mean, log_std = _moments(z, weights)
        return of(mean, math.exp(log_std))

    return start


def _of_logs(start: Start) -> Start:
    return lambda z, weights: start(np.log(z), weights)


def _above_threshold(start: Start) -> Start:
    """Return a start with a threshold at -1.5, which is theta = log 0.5: the values fill -1 to 1."""
    return lambda z, weights: (math.log(0.5), *start(z + 1.5, weights))


def _gumbel(mean: float, std: float) -> Theta:
    # Euler's constant 0.5772 is the mean of Gumbel's distribution of mode 0 and scale 1.
    scale = std * math.sqrt(6) / math.pi
    return mean - 0.5772 * scale, math.log(scale)


def _distance(z: Array, weights: Array) -> Theta:
    """Return the median, which is 0, and the logarithm of the mean distance from it: the maximum of the likelihood."""
    return 0.0, math.log(_mean(np.abs(z), weights))


def _halves(z: Array, weights: Array) -> Theta:
    """Return parameters from the moments of the values below and above the mean."""
    mean, log_std = _moments(z, weights)
    low, high = (_mean(z[side], weights[side]) for side in (z < mean, z >= mean))
    return 0.0, low, log_std - 0.5, high, log_std - 0.5


_WEIBULL = _of_logs(
    _of_moments(lambda m, s: (math.log(math.pi / math.sqrt(6) / s), m + 0.5772 * s * math.sqrt(6) / math.pi))
)
_GAMMA = _of_moments(lambda m, s: (math.log(m * m / s**2), math.log(s**2 / m)))
_LOGISTIC = _of_moments(lambda m, s: (m, math.log(s * math.sqrt(3) / math.pi)))

_NORMAL = {"mean": PLACE, "sd": WIDTH}
_LOGNORMAL = {"mean of log": OF_LOG, "sd of log": RATIO}
_SHAPE_AND_SCALE = {"shape": RATIO, "scale": WIDTH}
_LOG_LOGISTIC = {"mean of log": OF_LOG, "scale of log": RATIO}
_MODE_AND_SCALE = {"mode": PLACE, "scale": WIDTH}
_POWER = {"lambda": PLAIN, "mean": PLAIN, "sd": RATIO}

FAMILIES = {
    family.name: family
    for family in (
        Family("normal", "normal", _NORMAL, "free", forms.normal, _moments),
        Family("lognormal", "lognormal", _LOGNORMAL, "positive", partial(forms.lognormal, 0.0), _of_logs(_moments)),
        Family("weibull", "Weibull", _SHAPE_AND_SCALE, "positive", partial(forms.weibull, 0.0), _WEIBULL),
        Family("gamma", "gamma", _SHAPE_AND_SCALE, "positive", partial(forms.gamma, 0.0), _GAMMA),
        Family(
            "exponential", "exponential", {"scale": WIDTH}, "positive", partial(forms.exponential, 0.0),
            lambda z, w: (math.log(_mean(z, w)),),
        ),
        Family(
            "log_logistic", "log-logistic", _LOG_LOGISTIC, "positive",
            partial(forms.log_logistic, 0.0), _of_logs(_LOGISTIC),
        ),
        Family(
            "half_normal", "half-normal", {"sd": WIDTH}, "positive",
            partial(forms.folded_normal, 0.0), lambda z, w: (0.5 * math.log(_mean(z**2, w)),),
        ),
        Family("folded_normal", "folded normal", _NORMAL, "positive", forms.folded_normal, _moments),
        Family("logistic", "logistic", {"mean": PLACE, "scale": WIDTH}, "free", forms.logistic, _LOGISTIC),
        Family("laplace", "Laplace", {"median": PLACE, "scale": WIDTH}, "free", forms.laplace, _distance),
        Family(
            "largest_extreme", "largest extreme value", _MODE_AND_SCALE, "free",
            forms.largest_extreme, _of_moments(_gumbel),
        ),
        Family(
            "smallest_extreme", "smallest extreme value", _MODE_AND_SCALE, "free mirrored",
            forms.largest_extreme, _of_moments(_gumbel),
        ),
        Family(
            "student_t", "Student t", {"mean": PLACE, "scale": WIDTH, "degrees of freedom": FREEDOM}, "free",
            # with five degrees of freedom the variance is 5/3 of the squared scale
            forms.student_t, _of_moments(lambda m, s: (m, math.log(s * math.sqrt(0.6)), math.log(5.0))),
        ),
        Family(
            "box_cox", "normal after Box-Cox", _POWER, "positive",
            forms.box_cox_normal, lambda z, w: (0.0, *_moments(np.log(z), w)), framed=True,
        ),
        Family(
            "yeo_johnson", "normal after Yeo-Johnson", _POWER, "free",
            forms.yeo_johnson_normal, lambda z, w: (1.0, *_moments(z, w)), framed=True,
        ),
        Family(
            "weibull_above", "Weibull above a threshold", {"low": BELOW} | _SHAPE_AND_SCALE, "range",
            forms.weibull, _above_threshold(_WEIBULL),
        ),
        Family(
            "gamma_above", "gamma above a threshold", {"low": BELOW} | _SHAPE_AND_SCALE, "skewed",
            forms.gamma, _above_threshold(_GAMMA),
        ),
        Family(
            "log_logistic_above", "log-logistic above a threshold", {"low": BELOW} | _LOG_LOGISTIC, "skewed",
            forms.log_logistic, _above_threshold(_of_logs(_LOGISTIC)),
        ),
        Family(
            "johnson_sl", "Johnson SL, lognormal above a threshold", {"low": BELOW} | _LOGNORMAL, "skewed",
            forms.lognormal, _above_threshold(_of_logs(_moments)),
        ),
        Family(
            "johnson_sl_mirrored", "Johnson SL, lognormal below a threshold", {"high": BELOW} | _LOGNORMAL,
            "skewed mirrored", forms.lognormal, _above_threshold(_of_logs(_moments)),
        ),
        Family(
            "johnson_su", "Johnson SU", {"gamma": PLAIN, "delta": RATIO, "xi": PLACE, "lambda": WIDTH}, "free",
            forms.johnson_su, lambda *_: (0.0, 0.7, 0.0, 0.7),
        ),
        Family(
            "johnson_sb", "Johnson SB", {"gamma": PLAIN, "delta": RATIO, "low": BELOW, "high": ABOVE}, "range",
            forms.johnson_sb, lambda *_: (0.0, 0.0, -1.0, -1.0),
        ),
        Family(
            "two_normals", "mixture of two normals",
            {"share 1": SHARE, "mean 1": PLACE, "sd 1": WIDTH, "mean 2": PLACE, "sd 2": WIDTH}, "free",
            forms.two_normals, _halves,
        ),
    )
}  # fmt: skip
