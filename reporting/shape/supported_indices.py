"""Non-normal indices with intervals that allow for the choice of the family.

The values seldom distinguish one family from another, and families that agree on the values disagree on the range
beyond them. An interval therefore covers all parameters of all passing families whose log-likelihood, minus one for
each parameter (AIC), is within a threshold of the best: half of the chi-square quantile and of `AIC_MARGIN`. A family
as good as the best contributes an interval of more than the stated confidence, a family at the threshold only its fit.

Where a tail ends abruptly, as that of a cut distribution does, the families, whose tails are smooth, have too large a
share beyond a limit near the end: such a side has no largest Z-score and no smallest share.
"""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, ndtr

from reporting.arrays import Array
from reporting.capability.intervals import Interval, OpenInterval
from reporting.capability.moments import series
from reporting.capability.shares import PPM
from reporting.shape.atoms import ties
from reporting.shape.binned_sample import BinnedSample, bin_sample
from reporting.shape.fitting import AIC_MARGIN, Fit, Fits, handicap
from reporting.shape.nonnormal import NonnormalIndices, centred, fitted_indices, indices, less
from reporting.shape.parameter_draws import BINNED, parameter_draws, weighted_interval
from reporting.shape.tails import abrupt_ends

# Families whose ppm differ by more than this factor are shown as a range.
AGREEMENT = 3.0
# A larger Z-score, on the scale of an index, belongs to a share below the smallest floating-point number: the values
# then rule out no index, and the interval has no end.
_FARTHEST = 38.0 / 3
_ENDS_BEFORE = (
    "The values do not rule out a distribution that ends before a limit, or a share beyond it too small for a number: "
    "an interval has no upper end."
)
_CUT = (
    "The values end abruptly towards a limit, which no family does: its share beyond the limit is rather too large "
    "than too small, and an interval has no upper end."
)
_UNDEFINED = "No family that the values allow defines this index, so an interval is missing."
METHODS = ("percentile", "z_score")


def supported_indices(
    x: ArrayLike, fits: Fits, lsl: float | None, usl: float | None, confidence: float = 0.95
) -> tuple[NonnormalIndices, ...]:
    """Return the indices of the chosen family by percentiles and by Z-scores, with intervals over all candidates.

    One for each method, empty if no family passes. `x` are the fitted values; those that are not finite are left out.
    ReportError: `x` is not a series of numbers.
    """
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
    values = series(x)
    ordered = np.sort(values[np.isfinite(values)])
    sample = bin_sample(ties(ordered).spread(), BINNED)
    limited = {name: end for name, end in (("ppl", lsl), ("ppu", usl)) if end is not None}
    cut = {
        name for name, is_cut in zip(("ppl", "ppu"), abrupt_ends(ordered), strict=True) if is_cut and name in limited
    }
    parts = [
        _without_ends(_intervals(fit, sample, lsl, usl, _within(fit, fits, confidence)), cut, limited.keys())
        for fit in candidates
    ]
    ppm = _union(part["ppm"] for part in parts)
    results = []
    for point in points:
        names = [name for name in ("pp", "ppk", "ppl", "ppu") if getattr(point, name) is not None]
        over_all: dict[str, Any] = {
            f"{name}_interval": _open(_union(part[f"{point.method} {name}"] for part in parts)) for name in names
        }
        ends = [interval[1] for interval in over_all.values() if interval is not None]
        said = (_CUT,) if cut and point.method == "z_score" else (_ENDS_BEFORE,) if None in ends else ()
        notes = (*point.notes, *said)
        notes = (*notes, _UNDEFINED) if len(ends) < len(names) else notes
        results.append(replace(point, **found, **over_all, ppm_expected_interval=ppm, notes=notes))
    return tuple(results)


def supported_quantiles(x: Array, fits: Fits, shares: Sequence[float], confidences: Sequence[float]) -> Array:
    """Return the outermost ends of the intervals of quantiles over all candidates but the normal distribution.

    The shape is (confidences, shares, 2); minus and plus infinity, inside out, where there is no other candidate. `x`
    are the fitted values, all finite.
    """
    found = np.stack([np.full((len(confidences), len(shares)), end) for end in (math.inf, -math.inf)], axis=-1)
    sample = bin_sample(ties(np.sort(x)).spread(), BINNED)
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
    return max(float(2 * ndtr(math.sqrt(max(bar - handicap(fit, fits), 0.0))) - 1), 0.0)


def _intervals(
    fit: Fit, sample: BinnedSample, lsl: float | None, usl: float | None, confidence: float
) -> dict[str, Interval | None]:
    """Return the intervals of one family by method and index."""
    theta, weights = parameter_draws(fit, sample)
    low, high = less(lsl, fit.shift), less(usl, fit.shift)
    with np.errstate(all="ignore"):
        of = centred(fit, list(theta.T[:, :, None]))
        drawn = {
            f"{method} {name}": _of_known_shares(values) if method == "z_score" else values
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


def _of_known_shares(z: Array) -> Array:
    """Return Z-scores on the scale of an index; infinite if the share is too small for a floating-point number."""
    return np.where(np.abs(z) >= _FARTHEST, np.copysign(np.inf, z), z)


def _open(interval: Interval | None) -> OpenInterval | None:
    """Return an interval with None in place of an infinite end."""
    if interval is None:
        return None
    low, high = (end if math.isfinite(end) else None for end in interval)
    return low, high


def _interval(values: Array, weights: Array, confidence: float) -> Interval | None:
    """Return the interval of drawn values; None if most draws have no value."""
    known = ~np.isnan(values)
    total = float(np.sum(weights[known]))
    return weighted_interval(values[known], weights[known] / total, confidence) if total > 0.5 else None


def _union(intervals: Iterable[Interval | None]) -> Interval | None:
    """Return the smallest interval that contains all given intervals; None without any.

    After a power transformation the largest or smallest values may have no quantile: such a family is ignored.
    """
    known = [interval for interval in intervals if interval is not None]
    return (min(low for low, _ in known), max(high for _, high in known)) if known else None
