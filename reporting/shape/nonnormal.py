"""Capability of a response that is not normal, by three methods.

- Percentile method (Clements 1989, ISO 22514-2): the 0.135 %, 50 % and 99.865 % quantiles of the fitted distribution
  replace mean and six sigma.
- Z-score method (Minitab's default): the normal quantiles of the fitted distribution's shares out of limits.
  After a Box-Cox, Yeo-Johnson or Johnson transformation this is the capability of the transformed values within the
  transformed limits, and the percentiles are the +-3 sigma limits transformed back.
- Empirical percentiles (Cnpk): quantiles of the values themselves, at the ranks ``p (n + 1)`` (R's type 6).

Intervals of the fitted methods cover all families that the values do not rule out
(`reporting.shape.supported_indices`). Those of the empirical method follow from exact intervals of the percentiles.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtr, ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval, OpenInterval, bench
from reporting.capability.shares import PPM
from reporting.distributions.families import FAMILIES, Scaled
from reporting.distributions.forms import Parameter
from reporting.shape.fitting import Fit, distribution
from reporting.shape.sorted_sample import SortedSample, sorted_sample

FEWEST = 2731  # ln 0.025 / ln 0.99865
# Probabilities of the lower end, the middle and the upper end of a process (ISO 22514-2): -3, 0 and 3 normal sigmas.
ENDS = (0.00135, 0.5, 0.99865)
_TOO_FAR = "A limit is so far away that the share beyond it is too small for a number, so there is no Z-score."
_ENDS_BEFORE = "The share of the fitted distribution beyond a limit is 0, so there is no Z-score at this limit."


@dataclass(frozen=True)
class NonnormalIndices:
    """Indices by one method; None where undefined."""

    method: str  # "percentile", "z_score" or "empirical"
    family: str | None  # fitted; None for the empirical method
    assumed: str  # assumption of the method, in one sentence
    pp: float | None = None  # Pp to Ppu replace Cp, Cpk, Cpl and Cpu
    ppk: float | None = None
    ppl: float | None = None
    ppu: float | None = None
    pp_interval: OpenInterval | None = None  # two-sided; an end is None if the values give no bound on that side
    ppk_interval: OpenInterval | None = None
    ppl_interval: OpenInterval | None = None
    ppu_interval: OpenInterval | None = None
    percentiles: tuple[float, float, float] | None = None  # quantiles at `ENDS`, in the unit of the values
    z_lsl: float | None = None  # normal quantiles of the shares out of limits, for the fitted methods
    z_usl: float | None = None
    z_bench: float | None = None
    ppm_expected: float | None = None  # share of the fitted distribution out of limits; None for the empirical method
    ppm_expected_below: float | None = None
    ppm_expected_above: float | None = None
    ppm_expected_interval: Interval | None = None  # over all families that the values do not rule out
    # The smallest and the largest `ppm_expected` of these families, if they differ by more than a factor of 3, so that
    # no single number represents them.
    ppm_range: Interval | None = None
    candidates: tuple[str, ...] = ()  # titles of these families
    notes: tuple[str, ...] = ()  # why a number is None


def fitted_indices(method: str, fit: Fit, lsl: float | None, usl: float | None) -> NonnormalIndices:
    """Return the indices by the method "percentile" or "z_score" from one fitted distribution, without intervals."""
    fitted = distribution(fit)
    with np.errstate(all="ignore"):
        point = _finite(indices(method, centred(fit), *(less(limit, fit.shift) for limit in (lsl, usl))))
        # upper normal quantiles of the shares beyond the limits
        z_lsl = None if lsl is None else -float(normal_quantile(fitted.cdf(lsl), fitted.sf(lsl)))
        z_usl = None if usl is None else -float(normal_quantile(fitted.sf(usl), fitted.cdf(usl)))
        ends = fitted.ppf(ENDS)
    below = None if lsl is None else PPM * float(fitted.cdf(lsl))
    above = None if usl is None else PPM * float(fitted.sf(usl))
    sides = [share for share in (below, above) if share is not None]
    unbounded = any(z is not None and not math.isfinite(z) for z in (z_lsl, z_usl))
    return NonnormalIndices(
        method,
        fit.family,
        f"Assumed: the response follows the fitted distribution ({fit.title}), also beyond its extreme values.",
        **_with_ppk(point),
        percentiles=(float(ends[0]), float(ends[1]), float(ends[2])) if np.all(np.isfinite(ends)) else None,
        z_lsl=z_lsl if z_lsl is None or math.isfinite(z_lsl) else None,
        z_usl=z_usl if z_usl is None or math.isfinite(z_usl) else None,
        z_bench=None if unbounded else bench(z_lsl, z_usl),
        ppm_expected=sum(sides) if sides else None,
        ppm_expected_below=below,
        ppm_expected_above=above,
        notes=(_TOO_FAR if fit.family == "normal" else _ENDS_BEFORE,) if unbounded and method == "z_score" else (),
    )


def centred(fit: Fit, theta: Sequence[Parameter] | None = None) -> Scaled:
    """Return the distribution of ``x - shift``, so that an offset costs no digits; b of them for theta (b, 1)."""
    return Scaled(FAMILIES[fit.family].build(fit.theta if theta is None else theta), 0.0, fit.scale)


def less(limit: float | None, shift: float) -> float | None:
    """Return a limit of ``x - shift``."""
    return None if limit is None else limit - shift


def indices(method: str, of: Scaled, lsl: float | None, usl: float | None) -> dict[str, Any]:
    """Return Ppl, Ppu and Pp of a distribution by the percentile or Z-score method; arrays of b for b distributions."""
    if method == "percentile":
        return _of_percentiles(np.moveaxis(of.ppf(ENDS), -1, 0), lsl, usl)
    z_lsl = None if lsl is None else -normal_quantile(of.cdf([lsl])[..., 0], of.sf([lsl])[..., 0])
    z_usl = None if usl is None else -normal_quantile(of.sf([usl])[..., 0], of.cdf([usl])[..., 0])
    found = {name: z / 3 for name, z in (("ppl", z_lsl), ("ppu", z_usl)) if z is not None}
    return found if z_lsl is None or z_usl is None else found | {"pp": (z_lsl + z_usl) / 6}


def empirical_indices(
    x: ArrayLike | SortedSample, lsl: float | None, usl: float | None, confidence: float = 0.95
) -> NonnormalIndices:
    """Return the indices from the percentiles of the finite values (Cnpk), with intervals for any distribution."""
    ordered = sorted_sample(x).values
    assumed = "No distribution is assumed: the percentiles are those of the values themselves."
    if ordered.size < 2 or ordered[0] == ordered[-1]:
        return NonnormalIndices(
            "empirical", None, assumed, notes=("Fewer than two different values, so there is no index.",)
        )
    ends = empirical_percentiles(ordered, ENDS)
    with np.errstate(all="ignore"):  # percentiles may coincide
        point = _finite(_of_percentiles(ends, lsl, usl))
    notes: tuple[str, ...] = ()
    if ends[0] == ends[1] or ends[1] == ends[2]:
        notes = ("Most values are equal, so percentiles coincide and an index is missing.",)
    intervals: dict[str, Any] = {}
    if ordered.size * ENDS[0] < 1:
        notes += (f"Of {ordered.size} values the 0.135 % percentiles are the extremes, so the indices are too large.",)
    if ordered.size < FEWEST:
        notes += (f"{ordered.size} values are too few for an interval of a 0.135 % percentile: {FEWEST} are needed.",)
    else:
        with np.errstate(all="ignore"):
            bounds = interval_of_quantiles(ordered, ENDS, lambda q: _of_percentiles(q, lsl, usl), confidence)
        intervals = {f"{name}_interval": bounds.get(name) for name in ("pp", "ppl", "ppu")}
        sides = [bounds[name] for name in ("ppl", "ppu") if name in bounds]
        if sides and len(sides) == sum(name in point for name in ("ppl", "ppu")):
            # The side that is nearer in the sample need not be the nearer side of the process.
            intervals["ppk_interval"] = min(low for low, _ in sides), min(high for _, high in sides)
    return NonnormalIndices(
        "empirical",
        None,
        assumed,
        **_with_ppk(point),
        **intervals,
        percentiles=(float(ends[0]), float(ends[1]), float(ends[2])),
        notes=notes,
    )


def _of_percentiles(ends: Array, lsl: float | None, usl: float | None) -> dict[str, Any]:
    """Return the indices from three percentiles, shape (3,), or from m such triples, shape (3, m)."""
    low, median, high = ends
    indices = {}
    if lsl is not None:
        indices["ppl"] = (median - lsl) / (median - low)
    if usl is not None:
        indices["ppu"] = (usl - median) / (high - median)
    if lsl is not None and usl is not None:
        indices["pp"] = (usl - lsl) / (high - low)
    return indices


def normal_quantile(share: Array, rest: Array) -> Array:
    """Return the normal quantile of a share, computed from the smaller of the share and its complement."""
    return np.asarray(np.where(share < rest, ndtri(share), -ndtri(rest)))


def _finite(point: dict[str, float]) -> dict[str, float]:
    """Return the indices that are finite."""
    return {name: float(value) for name, value in point.items() if math.isfinite(value)}


def _with_ppk(point: dict[str, float]) -> dict[str, Any]:
    """Return the indices with Ppk, the smaller one-sided index."""
    sides = [point[name] for name in ("ppl", "ppu") if name in point]
    return point | {"ppk": min(sides)} if sides else point


# Ranks, empirical quantiles, and statistics of a few quantiles, with exact intervals.
#
# The number of values below a quantile of the true distribution is binomial, so two ordered values enclose the quantile
# with a known probability, whatever the distribution (David, Nagaraja, Order Statistics, section 7.1). A quantile at
# 0.135 % needs values beyond it: with at least `FEWEST` values both ends of its interval lie within the sample.


def empirical_percentiles(ordered: Array, shares: Sequence[float]) -> Array:
    """Return the quantiles of ascending values at the ranks ``p (n + 1)``, interpolated (R's type 6)."""
    rank = np.clip(np.asarray(shares) * (ordered.size + 1), 1.0, float(ordered.size))
    low = np.floor(rank).astype(np.int64)  # counted from 1
    below, above = ordered[low - 1], ordered[np.minimum(low, ordered.size - 1)]
    return np.asarray(below + (rank - low) * (above - below))


def quantile_interval(ordered: Array, share: float, confidence: float) -> Interval | None:
    """Return the two of ascending values that enclose a quantile; None if they are too few for the confidence."""
    n, miss = ordered.size, (1 - confidence) / 2
    # Ten standard deviations hold every rank that an end can have, and spare the binomial sums of all n.
    spread = 10 * np.sqrt(n * share * (1 - share)) + 10
    rank = np.arange(max(int(n * share - spread), 0), min(int(n * share + spread), n) + 1)
    below = bdtr(rank.astype(np.float64), n, share)  # probability of at most `rank` values below the quantile
    low = int(rank[np.searchsorted(below, miss, side="right")])
    high = int(rank[np.searchsorted(below, 1 - miss)]) + 1
    if low < 1 or high > n:
        return None
    return float(ordered[low - 1]), float(ordered[high - 1])


def interval_of_quantiles(
    ordered: Array, shares: Sequence[float], statistics: Callable[[Array], dict[str, float]], confidence: float
) -> dict[str, Interval]:
    """Return intervals of `statistics` of a few quantiles, by name; empty if the sample is too small.

    Each quantile is moved alone to both ends of its interval; the changes add as squares (Zou, Donner 2008).
    """
    ends = [quantile_interval(ordered, share, confidence) for share in shares]
    middle = empirical_percentiles(ordered, shares)
    point = statistics(middle)
    down, up = dict.fromkeys(point, 0.0), dict.fromkeys(point, 0.0)
    for i, pair in enumerate(ends):
        if pair is None:
            return {}
        for end in pair:
            moved = statistics(np.where(np.arange(middle.size) == i, end, middle))
            for name, value in point.items():
                move = float(moved[name] - value)
                down[name], up[name] = down[name] + min(move, 0.0) ** 2, up[name] + max(move, 0.0) ** 2
    found = {name: (float(v - np.sqrt(down[name])), float(v + np.sqrt(up[name]))) for name, v in point.items()}
    return {name: interval for name, interval in found.items() if np.all(np.isfinite(interval))}
