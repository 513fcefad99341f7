"""The generalized Pareto distribution of excesses over a threshold: two estimators, a share, a goodness-of-fit test.

Whatever the distribution of a value, its excesses over a high threshold tend to
``P(Y > y) = (1 + xi y / sigma)^(-1/xi)`` (Pickands 1975; Balkema, de Haan 1974). For xi < 0 the distribution has an
end, for xi = 0 it is exponential.

The two estimators serve different purposes, and neither can replace the other: the interval of a share beyond a limit
is a profile likelihood, which needs the maximum of the likelihood; Pareto smoothing of weights is calibrated for the
posterior mean of Zhang and Stephens.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, ndtri

from reporting.arrays import ROUNDING, Array
from reporting.capability.intervals import Interval, share_interval
from reporting.capability.shares import PPM
from reporting.shape.sorted_sample import SortedSample, sorted_sample

# Shapes searched: below -0.5 the likelihood is not regular (the tail ends abruptly), above 0.5 there is no variance.
SHAPES = (-0.5, 0.75)
# Below this logarithm of a share no excess reaches the limit, and the profile is flat.
_LEAST_LOG_SHARE = -60.0
_TINY_SHAPE = 1e-6
# 5 % points of the Cramer-von Mises statistic with both parameters fitted, simulated with 4,500 fits of 200 excesses
# at each shape. Choulakian and Stephens (2001) tabulate the same statistic.
CRITICAL_SHAPES, CRITICAL = (-0.5, -0.25, 0.0, 0.25, 0.5), (0.190, 0.169, 0.148, 0.135, 0.122)


@dataclass(frozen=True)
class ParetoFit:
    """A fitted tail."""

    shape: float  # xi
    scale: float  # sigma, in the unit of the excesses
    loglik: float  # density in 1/unit

    @property
    def is_abrupt(self) -> bool:
        """Whether it ends abruptly: a shape at the lower bound says that the likelihood is not regular."""
        return self.shape <= SHAPES[0]

    def survival(self, y: float) -> float:
        """Return the share of excesses beyond `y`."""
        if abs(self.shape) < _TINY_SHAPE:
            return math.exp(-y / self.scale)
        inside = 1 + self.shape * y / self.scale
        return inside ** (-1 / self.shape) if inside > 0 else 0.0


def maximum_likelihood_fit(excesses: Array) -> ParetoFit:
    """Return the maximum-likelihood fit to excesses above 0, shape (k,), that are not all equal.

    For a given ``theta = xi / sigma`` the best shape is the mean of ``ln(1 + theta y)`` (Grimshaw 1993): one variable.
    """
    largest, mean = float(np.max(excesses)), float(np.mean(excesses))

    def profile(theta: float) -> ParetoFit:
        if abs(theta) * mean < _TINY_SHAPE:
            return ParetoFit(0.0, mean, -excesses.size * (math.log(mean) + 1))
        shape = min(max(float(np.mean(np.log1p(theta * excesses))), SHAPES[0]), SHAPES[1])
        return ParetoFit(shape, shape / theta, loglik(excesses, shape, shape / theta))

    # theta > -1 / largest: the distribution must not end before the largest excess.
    grid = np.concatenate((-(1 - np.geomspace(1e-3, 0.999, 40)) / largest, [0.0], np.geomspace(1e-3, 20, 40) / mean))
    return profile(_maximum(lambda theta: profile(theta).loglik, grid))


def posterior_mean_fit(excesses: Array) -> tuple[float, float]:
    """Return shape and scale of ascending excesses by the posterior mean of ``-xi / sigma`` (Zhang, Stephens 2009).

    The shape is shrunk towards 0.5 with the weight of ten values, as in Pareto-smoothed importance sampling.
    """
    n = excesses.size
    points = 30 + int(math.sqrt(n))
    quartile = excesses[math.floor(n / 4 + 0.5) - 1]
    b = 1 / excesses[-1] + (1 - np.sqrt(points / (np.arange(1, points + 1) - 0.5))) / (3 * quartile)
    shapes = np.mean(np.log1p(-b[:, None] * excesses), axis=1)
    likelihood = n * (np.log(-b / shapes) - shapes - 1)
    posterior = np.exp(likelihood - likelihood.max())
    mean_b = float(np.sum(b * posterior) / posterior.sum())
    shape = float(np.mean(np.log1p(-mean_b * excesses)))
    return (n * shape + 10 * 0.5) / (n + 10), -shape / mean_b


def quantiles(shape: float, scale: float, p: Array) -> Array:
    """Return the quantiles for the probabilities `p`."""
    if abs(shape) < 1e-12:
        return np.asarray(-scale * np.log1p(-p))
    return np.asarray(scale * np.expm1(-shape * np.log1p(-p)) / shape)


def loglik(excesses: Array, shape: float, scale: float) -> float:
    """Return the log-likelihood of excesses; minus infinity if one lies beyond the end of the distribution."""
    if not scale > 0:
        return -math.inf
    if abs(shape) < _TINY_SHAPE:
        return -excesses.size * math.log(scale) - float(np.sum(excesses)) / scale
    inside = 1 + shape * excesses / scale
    if float(inside.min()) <= 0:
        return -math.inf
    return -excesses.size * math.log(scale) - (1 + 1 / shape) * float(np.sum(np.log(inside)))


def survival_interval(excesses: Array, y: float, fit: ParetoFit, confidence: float) -> Interval:
    """Return the profile-likelihood interval of the share of excesses beyond `y`; it never extends below zero."""
    from scipy.optimize import brentq  # takes 0.4 s to import, which `import reporting` avoids

    # At the ends of the interval the log-likelihood has fallen by half the chi-square quantile (likelihood ratio).
    drop = float(chdtri(1, 1 - confidence)) / 2
    estimate = fit.survival(y)
    centre = min(math.log(max(estimate, math.exp(_LEAST_LOG_SHARE))), -1e-6)

    def below_bar(log_share: float) -> float:
        return fit.loglik - drop - _profile(excesses, y, log_share)

    if below_bar(centre) >= 0:  # the limit is so far beyond the end that no other share is possible
        return estimate, estimate
    low, high = 0.0, 1.0
    if below_bar(_LEAST_LOG_SHARE) > 0 and centre > _LEAST_LOG_SHARE:
        low = math.exp(brentq(below_bar, _LEAST_LOG_SHARE, centre, xtol=1e-4))
    if below_bar(-1e-6) > 0:
        high = math.exp(brentq(below_bar, centre, -1e-6, xtol=1e-4))
    return low, high


def cramer_von_mises(excesses: Array, fit: ParetoFit) -> float:
    """Return the Cramer-von Mises statistic of ascending excesses against a fit."""
    if abs(fit.shape) < _TINY_SHAPE:
        share = -np.expm1(-excesses / fit.scale)
    else:
        share = 1 - np.maximum(1 + fit.shape * excesses / fit.scale, 1e-300) ** (-1 / fit.shape)
    k = excesses.size
    return 1 / (12 * k) + float(np.sum((share - (np.arange(1, k + 1) - 0.5) / k) ** 2))


def critical_cramer_von_mises(shape: float) -> float:
    """Return the 5 % point of `cramer_von_mises`, interpolated between the simulated shapes."""
    return float(np.interp(shape, CRITICAL_SHAPES, CRITICAL))


def _profile(excesses: Array, y: float, log_share: float) -> float:
    """Return the largest log-likelihood of a distribution with the given log-share beyond `y`."""

    def at(shape: float) -> float:
        if abs(shape) < _TINY_SHAPE:
            return loglik(excesses, 0.0, -y / log_share)
        return loglik(excesses, shape, shape * y / math.expm1(-shape * log_share))

    return at(_maximum(at, np.linspace(*SHAPES, 21)))


def _maximum(f: Callable[[float], float], grid: Array) -> float:
    """Return the maximiser of `f`, searched between the neighbours of the best point of an ascending grid."""
    from scipy.optimize import minimize_scalar  # see `survival_interval`

    values = [f(float(point)) for point in grid]
    best = int(np.argmax(values))
    ends = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)])
    search = {"xatol": 1e-6 * (ends[1] - ends[0])}
    with np.errstate(invalid="ignore"):  # the likelihood of an impossible distribution is minus infinity
        top = minimize_scalar(lambda point: -f(point), bounds=ends, method="bounded", options=search)
    return float(top.x if -top.fun > values[best] else grid[best])


# Shares far out in a tail, with too few rejects to count.

# Fewer excesses do not determine the shape; more are affected by the curvature of a normal tail: with 2,000 of 30,000
# values the interval of a share of 30 ppm missed it every other time, with 250 as often as stated.
FEWEST_EXCESSES, MOST_EXCESSES, LARGEST_SHARE = 50, 250, 0.10
# How many numbers of excesses are tried: the largest, its half, and so on.
_THRESHOLDS = 3
# A model of the tail is not used for shares below this part of one value: its upper end is never lower.
_FARTHEST = 0.01
# With this many rejects or more the count is better than any model.
ENOUGH_REJECTS = 100


@dataclass(frozen=True)
class TailShare:
    """Share of a response beyond one limit, from a model of the tail."""

    side: str  # "below" or "above"
    limit: float  # in the unit of the values
    ppm: float | None  # None if it is refused, or too far beyond the values for a number
    interval: Interval | None  # two-sided [ppm]; without an estimate it is an upper bound
    method: str = "pareto"
    threshold: float | None = None  # beginning of the fitted tail
    excesses: int | None = None  # values beyond it
    shape: float | None = None  # of the Pareto tail; if negative it has an end
    scale: float | None = None
    note: str = ""  # why the estimate is refused, why there is only a bound, or none from below; may be empty


def pareto_tails(
    x: ArrayLike | SortedSample, lsl: float | None, usl: float | None, confidence: float = 0.95
) -> tuple[TailShare, ...]:
    """Return the share of finite values beyond each limit from a generalized Pareto tail, the lower limit first.

    Tails are fitted beyond several thresholds (250 excesses or a tenth of the values, and halves of that down to 50);
    those that the Cramer-von Mises statistic rejects at 5 % are ignored. The estimate is that of the most excesses, the
    interval covers those of all thresholds: with many excesses a tail is precise but may still be curved, and one
    threshold alone missed the share in up to 26 of 100 samples of 2,000. An estimate below a hundredth of one value is
    not given: then the upper end is a bound, and at least that of an exponential tail, because a tail that seems to end
    before the limit may not end. Beyond a heavy tail without a value beyond the limit the interval begins at 0: 1 % of
    500 values shifted by six sigmas look like one, and without this the lower end was too high in 9 of 10 campaigns.
    """
    ordered = sorted_sample(x).values
    lower = () if lsl is None else (_tail("below", -ordered[::-1], -lsl, confidence),)
    return lower if usl is None else (*lower, _tail("above", ordered, usl, confidence))


def abrupt_ends(ordered: Array) -> tuple[bool, bool]:
    """Return whether the lower and the upper tail end abruptly, as those of a cut distribution; False if unknown.

    Of 500 values of a normal distribution cut at 2 sigma 92 % of the tails are found, of uncut ones 3 % taken for cut.
    """
    k = min(MOST_EXCESSES, int(LARGEST_SHARE * ordered.size))

    def is_abrupt(ascending: Array) -> bool:
        if _refusal(ascending, 0, k):
            return False
        excesses = ascending[-k:] - ascending[-k - 1]
        return excesses[0] > 0 and maximum_likelihood_fit(excesses).is_abrupt

    return is_abrupt(-ordered[::-1]), is_abrupt(ordered)


def _tail(side: str, ordered: Array, limit: float, confidence: float) -> TailShare:
    """Return the share above `limit` of ascending values; for the lower side both are mirrored."""
    sign = -1.0 if side == "below" else 1.0
    n = int(ordered.size)
    most = min(MOST_EXCESSES, int(LARGEST_SHARE * n))
    rejects = n - int(np.searchsorted(ordered, limit, side="right"))
    refusal = _refusal(ordered, rejects, most)
    if refusal:
        return TailShare(side, sign * limit, None, None, note=refusal)
    # each tail begins before the limit, the largest first
    fewest = min(max(FEWEST_EXCESSES, rejects + 1), most)
    sizes = sorted({max(most // 2**i, fewest) for i in range(_THRESHOLDS)}, reverse=True)
    fits = [tail for k in sizes if (tail := _beyond_threshold(ordered, limit, k))]
    if not fits:
        count = f"{FEWEST_EXCESSES} to {most}" if most > FEWEST_EXCESSES else f"{most}"
        note = f"A Pareto distribution fits none of the tails of {count} values."
        return TailShare(side, sign * limit, None, None, note=note)
    threshold, excesses, fit = fits[0]
    estimates = [_beyond(y, limit - at, beyond, n, confidence) for at, y, beyond in fits]
    ppm, least = estimates[0][0], PPM * _FARTHEST / n
    low, high = min(ends[0] for _, ends in estimates), max(ends[1] for _, ends in estimates)
    note = ""
    if ppm < least:
        low, high = 0.0, max(high, *(_exponential_bound(y, limit - at, n, confidence) for at, y, _ in fits))
        why = f"The limit is too far beyond {n} values for a number" if ppm else "The fitted tail ends before the limit"
        note = f"{why}, so there is only an upper bound."
    elif limit > ordered[-1] and fit.shape > (1.0 + fit.shape) / math.sqrt(excesses.size):  # a standard error above 0
        low = 0.0
        note = "A heavy tail looks like a few values of another kind, whose share beyond the limit may be far smaller."
    return TailShare(
        side, sign * limit, ppm if ppm >= least else None, (low, max(high, least)),
        threshold=sign * threshold, excesses=excesses.size, shape=fit.shape, scale=fit.scale, note=note,
    )  # fmt: skip


def _beyond_threshold(ordered: Array, limit: float, k: int) -> tuple[float, Array, ParetoFit] | None:
    """Return threshold, excesses and fit of the tail of `k` values; None if no Pareto tail fits them."""
    threshold = float(ordered[-k - 1])
    excesses = ordered[-k:] - threshold
    if excesses[0] <= 0 or limit <= threshold:
        return None
    fit = maximum_likelihood_fit(excesses)
    fits = cramer_von_mises(excesses, fit) <= critical_cramer_von_mises(fit.shape)
    return (threshold, excesses, fit) if fits and not fit.is_abrupt else None


def _refusal(ordered: Array, rejects: int, most: int) -> str:
    """Return why no tail can be fitted; empty if one can be."""
    n = ordered.size
    if most < FEWEST_EXCESSES:
        return f"{n} values are too few for a tail: {math.ceil(FEWEST_EXCESSES / LARGEST_SHARE)} are needed."
    if rejects >= min(ENOUGH_REJECTS, most):
        return f"{rejects} values are beyond the limit, so the counted share is better than any model of the tail."
    top = ordered[n - most :]
    if top[-1] - top[0] <= ROUNDING * float(np.max(np.abs(top))):
        return "The values in the tail are all equal, so no tail is fitted."
    if np.unique(top).size < 0.9 * top.size:
        return "Values in the tail repeat, because they are rounded or bounded, so no smooth tail fits them."
    return ""


def _beyond(excesses: Array, y: float, fit: ParetoFit, n: int, confidence: float) -> tuple[float, Interval]:
    """Return the ppm beyond a limit at the distance `y` from the threshold, and its interval."""
    over = excesses.size / n
    share = fit.survival(y)
    low, high = survival_interval(excesses, y, fit, confidence)
    over_low, over_high = share_interval(excesses.size, n, confidence)
    if share == 0:
        return 0.0, (0.0, PPM * min(over_high * high, 1.0))
    lowest = 0.0
    if low > 0:
        lowest = over * share * math.exp(-math.hypot(math.log(share / low), math.log(over / over_low)))
    highest = over * share * math.exp(math.hypot(math.log(high / share), math.log(over_high / over)))
    return PPM * over * share, (PPM * lowest, PPM * min(highest, 1.0))


def _exponential_bound(excesses: Array, y: float, n: int, confidence: float) -> float:
    """Return the upper end [ppm] of the share of an exponential tail beyond a distance `y` from the threshold."""
    over, scale = excesses.size / n, y / float(np.mean(excesses))
    _, highest = share_interval(excesses.size, n, confidence)
    of_mean = float(ndtri(0.5 + confidence / 2)) * scale / math.sqrt(excesses.size)
    return PPM * min(over * math.exp(-scale + math.hypot(of_mean, math.log(highest / over))), 1.0)
