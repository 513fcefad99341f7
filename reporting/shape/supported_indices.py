"""Non-normal indices with intervals that allow for the choice of the family.

The values seldom distinguish one family from another, and families that agree on the values disagree on the range
beyond them. An interval therefore covers all parameters of all passing families whose log-likelihood, minus one for
each parameter (AIC), is within a threshold of the best: half of the chi-square quantile and of `AIC_MARGIN`. A family
as good as the best contributes an interval of more than the stated confidence, a family at the threshold only its fit.

Where a tail ends abruptly, as that of a cut distribution does, the families, whose tails are smooth, have too large a
share beyond a limit near the end: such a side has no largest Z-score and no smallest share.

Values that are rounded coarsely do not show where within half a step of a limit the share beyond it begins: intervals
cover limits half a step nearer and farther.
"""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, ndtr, ndtri

from reporting.arrays import Array, standard_deviation
from reporting.capability.intervals import Interval, OpenInterval
from reporting.capability.shares import PPM
from reporting.distributions.families import FAMILIES
from reporting.shape.fitting import AIC_MARGIN, PRACTICAL, Fit, Fits, curvature, handicap, log_likelihood
from reporting.shape.nonnormal import NonnormalIndices, centred, fitted_indices, indices, less
from reporting.shape.pareto import abrupt_ends
from reporting.shape.sorted_sample import BinnedSample, SortedSample, bin_sample, sorted_sample

# Plausible parameters of a fit, drawn in proportion to their likelihood.
#
# They are drawn from the normal distribution given by the curvature of the likelihood, evenly instead of at random, and
# weighted by the likelihood itself (importance sampling), so that results computed from them may be skewed. Where the
# likelihood is flat, the parameters vary within a bound.

# Number of weighted values that represent the sample.
BINNED = 240
_DRAWS = 600
# The draws extend beyond the curvature's range by this factor, but at most this far: parameters are of order one.
_BEYOND, _FARTHEST = 1.4, 1.5


def parameter_draws(fit: Fit, sample: BinnedSample) -> tuple[Array, Array]:
    """Return parameters, shape (draws, k), and their weights, shape (draws,), which sum to 1.

    More than `PRACTICAL` values weigh as so many: a family is a model, and more values do not make its tails certain.
    """
    theta, n = np.asarray(fit.theta), sample.n
    worth = min(1.0, PRACTICAL / n) * (1 - theta.size / n)
    loglik = log_likelihood(FAMILIES[fit.family], sample.scaled(fit.shift, fit.scale))
    with np.errstate(all="ignore"):
        information = curvature(loglik, fit.theta)
        if information is None:
            return theta[None], np.ones(1)
        steepness, axes = np.linalg.eigh(worth * information)
        reach = np.minimum(_BEYOND / np.sqrt(np.maximum(steepness, 1e-12)), _FARTHEST)
        scores = _even_normals(_DRAWS, theta.size)
        drawn = theta + (scores * reach) @ axes.T
        # The likelihood over the normal density of the scores from which the parameters are drawn.
        log_weights = worth * loglik(drawn) + 0.5 * np.sum(scores**2, axis=1)
    log_weights = np.where(np.isfinite(log_weights), log_weights, -np.inf)
    weights = np.exp(log_weights - np.max(log_weights)) if np.any(np.isfinite(log_weights)) else np.ones(_DRAWS)
    return drawn, weights / np.sum(weights)


def weighted_interval(values: Array, weights: Array, confidence: float) -> Interval:
    """Return the quantiles of values with weights of sum 1 that leave out equal shares at both ends."""
    order = np.argsort(values)
    below = np.cumsum(weights[order]) - weights[order] / 2
    ends = np.searchsorted(below, ((1 - confidence) / 2, (1 + confidence) / 2))
    low, high = values[order][np.clip(ends - np.array([1, 0]), 0, values.size - 1)]
    return float(low), float(high)


def _even_normals(count: int, k: int) -> Array:
    """Return points, (count, k), that fill a normal distribution evenly, by golden ratios (Roberts 2018)."""
    phi = 2.0
    # Each step of this fixed-point iteration divides the error by 3 or more.
    for _ in range(40):
        phi = (1 + phi) ** (1 / (k + 1))
    steps = phi ** -np.arange(1.0, k + 1)
    return np.asarray(ndtri((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0))


# Families whose ppm differ by more than this factor are shown as a range.
AGREEMENT = 3.0
# A larger Z-score, on the scale of an index, belongs to a share below the smallest floating-point number: the values
# then rule out no index, and the interval has no end.
_TINY = 38.0 / 3
_ENDS_BEFORE = (
    "The values do not rule out a distribution that ends before a limit, or a share beyond it too small for a number: "
    "an interval has no upper end."
)
_CUT = (
    "The values end abruptly towards a limit, which no family does: its share beyond the limit is rather too large "
    "than too small, and an interval has no upper end."
)
_UNDEFINED = "No family that the values allow defines this index, so an interval is missing."
_ROUNDED = "The values are rounded to steps of {:.1g} sigma: intervals allow for limits half a step nearer and farther."
METHODS = ("percentile", "z_score")
# Steps of rounded values, in sigmas, above which their limits are moved: below it changes a ppm by less than a tenth.
_COARSE = 0.1


def supported_indices(
    x: ArrayLike | SortedSample, fits: Fits, lsl: float | None, usl: float | None, confidence: float = 0.95
) -> tuple[NonnormalIndices, ...]:
    """Return the indices of the chosen family by both methods, with intervals over all candidates."""
    best = fits.of(fits.best)
    if best is None:
        return ()
    points = tuple(fitted_indices(method, best, lsl, usl) for method in METHODS)
    candidates = [fit for fit in fits.fits if fit.family in fits.candidates]
    expected = [fitted_indices("z_score", fit, lsl, usl).ppm_expected or 0.0 for fit in candidates]
    disagree = bool(expected) and max(expected) > AGREEMENT * min(expected)
    found: dict[str, Any] = {
        "candidates": tuple(fit.title for fit in candidates),
        "ppm_range": (min(expected), max(expected)) if disagree else None,
    }
    given = sorted_sample(x)
    ordered, tied = given.values, given.repetition
    sample, step = bin_sample(given.spread, BINNED), tied.step / standard_deviation(ordered)
    moves = (-tied.step / 2, tied.step / 2) if step > _COARSE else (0.0,)
    limited = {name: end for name, end in (("ppl", lsl), ("ppu", usl)) if end is not None}
    cut = {
        name for name, is_cut in zip(("ppl", "ppu"), abrupt_ends(ordered), strict=True) if is_cut and name in limited
    }
    parts = [
        _without_ends(
            _intervals(fit, sample, less(lsl, move), less(usl, -move), _within(fit, fits, confidence)),
            cut,
            limited.keys(),
        )
        for fit in candidates
        for move in moves
    ]
    ppm = _union(part["ppm"] for part in parts)
    results = []
    for point in points:
        names = [name for name in ("pp", "ppk", "ppl", "ppu") if getattr(point, name) is not None]
        over_all: dict[str, Any] = {
            f"{name}_interval": _union_with_ends(part[f"{point.method} {name}"] for part in parts) for name in names
        }
        ends = [interval[1] for interval in over_all.values() if interval is not None]
        said = (_CUT,) if cut and point.method == "z_score" else (_ENDS_BEFORE,) if None in ends else ()
        rounded = (_ROUNDED.format(step),) if len(moves) > 1 else ()
        notes = (*point.notes, *rounded, *said)
        notes = (*notes, _UNDEFINED) if len(ends) < len(names) else notes
        results.append(replace(point, **found, **over_all, ppm_expected_interval=ppm, notes=notes))
    return tuple(results)


def supported_quantiles(
    given: SortedSample, fits: Fits, shares: Sequence[float], confidences: Sequence[float]
) -> Array:
    """Return the outermost ends of intervals of quantiles of values, over all candidates but the normal one.

    Their shape is (confidences, shares, 2); infinity and minus infinity, inside out, where there is no other candidate.
    """
    found = np.stack([np.full((len(confidences), len(shares)), end) for end in (math.inf, -math.inf)], axis=-1)
    sample = bin_sample(given.spread, BINNED)
    for fit in fits.fits:
        if fit.family not in fits.candidates or fit.family == "normal":
            continue
        theta, weights = parameter_draws(fit, sample)
        with np.errstate(all="ignore"):
            quantiles = fit.shift + centred(fit, list(theta.T[:, :, None])).ppf(shares)
        for ends, confidence in zip(found, confidences, strict=True):
            within = _within(fit, fits, confidence)
            for i, interval in enumerate(_interval(column, weights, within) for column in quantiles.T):
                if interval is not None:
                    ends[i] = min(ends[i, 0], interval[0]), max(ends[i, 1], interval[1])
    return found


def _within(fit: Fit, fits: Fits, confidence: float) -> float:
    """Return the confidence of the interval that a candidate contributes, less the farther it is from the best."""
    bar = float(chdtri(1, 1 - confidence)) + AIC_MARGIN
    return max(float(2 * ndtr(math.sqrt(max(bar - handicap(fit, fits.fits), 0.0))) - 1), 0.0)


def _intervals(
    fit: Fit, sample: BinnedSample, lsl: float | None, usl: float | None, confidence: float
) -> dict[str, Interval | None]:
    theta, weights = parameter_draws(fit, sample)
    low, high = less(lsl, fit.shift), less(usl, fit.shift)
    with np.errstate(all="ignore"):
        of = centred(fit, list(theta.T[:, :, None]))
        drawn = {
            # infinite if the share is too small for a floating-point number
            f"{method} {name}": np.where(np.abs(values) >= _TINY, np.copysign(np.inf, values), values)
            if method == "z_score"
            else values
            for method in METHODS
            for name, values in indices(method, of, low, high).items()
        }
        for method in METHODS:
            sides = [drawn[f"{method} {name}"] for name in ("ppl", "ppu") if f"{method} {name}" in drawn]
            drawn |= {f"{method} ppk": np.minimum(sides[0], sides[-1])} if sides else {}
        shares = {"ppl": of.cdf([low])[..., 0]} if low is not None else {}
        shares |= {"ppu": of.sf([high])[..., 0]} if high is not None else {}
        drawn |= {f"ppm {side}": PPM * np.asarray(share) for side, share in shares.items()}
        drawn["ppm"] = PPM * np.asarray(sum(shares.values()))
    return {name: _interval(values, weights, confidence) for name, values in drawn.items()}


def _without_ends(
    found: dict[str, Interval | None], cut: Collection[str], sides: Collection[str]
) -> dict[str, Interval | None]:
    """Return intervals by Z-scores without the ends that a distribution cut at these sides could exceed."""
    if not cut:
        return found

    def end(name: str) -> float:
        interval = found[f"z_score {name}"]
        return math.inf if name in cut or interval is None else interval[1]

    kept = [found[f"ppm {side}"] for side in sides if side not in cut]
    least = min((interval[0] for interval in kept if interval is not None), default=0.0)
    changed = dict(found)
    ends = {**dict.fromkeys(("pp", *cut), math.inf), "ppk": min(end(side) for side in sides)}
    for name, high in ends.items():
        if (interval := found.get(f"z_score {name}")) is not None:
            changed[f"z_score {name}"] = interval[0], max(interval[1], high)
    if (share := found["ppm"]) is not None:
        changed["ppm"] = min(share[0], least), share[1]
    return changed


def _union_with_ends(intervals: Iterable[Interval | None]) -> OpenInterval | None:
    """Return the union of intervals with None in place of an infinite end."""
    if (found := _union(intervals)) is None:
        return None
    low, high = (end if math.isfinite(end) else None for end in found)
    return low, high


def _interval(values: Array, weights: Array, confidence: float) -> Interval | None:
    """Return the interval of drawn values; None if most draws have no value."""
    known = ~np.isnan(values)
    total = float(np.sum(weights[known]))
    return weighted_interval(values[known], weights[known] / total, confidence) if total > 0.5 else None


def _union(intervals: Iterable[Interval | None]) -> Interval | None:
    """Return the smallest interval that contains all given ones; a family without one (None) does not count."""
    known = [interval for interval in intervals if interval is not None]
    return (min(low for low, _ in known), max(high for _, high in known)) if known else None
