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
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtr, ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval, OpenInterval, bench
from reporting.capability.moments import series
from reporting.capability.shares import PPM
from reporting.distributions.families import FAMILIES, Scaled
from reporting.distributions.forms import Parameter
from reporting.shape.fitting import Fit, distribution

# ln 0.025 / ln 0.99865.
FEWEST = 2731


# Probabilities of the lower end, the middle and the upper end of a process (ISO 22514-2): -3, 0 and 3 normal sigmas.
ENDS = (0.00135, 0.5, 0.99865)


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
        z_lsl, z_usl = _z(fitted, lsl, usl)
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
        notes=(_beyond(fit.family),) if unbounded and method == "z_score" else (),
    )


def centred(fit: Fit, theta: Sequence[Parameter] | None = None) -> Scaled:
    """Return the distribution of ``x - shift``, so that a large offset of the values costs no digits.

    Other parameters `theta` may be arrays of shape (b, 1), for b distributions.
    """
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
    return _of_z(z_lsl, z_usl)


def _beyond(family: str) -> str:
    """Return why there is no Z-score at a limit: the share beyond it is 0, or too small to be a number."""
    if family == "normal":
        return "A limit is so far away that the share beyond it is too small for a number, so there is no Z-score."
    return "The share of the fitted distribution beyond a limit is 0, so there is no Z-score at this limit."


def empirical_indices(x: ArrayLike, lsl: float | None, usl: float | None, confidence: float = 0.95) -> NonnormalIndices:
    """Return the indices from the percentiles of the values (Cnpk), with intervals for any distribution.

    Values that are not finite are left out. ReportError: `x` is not a series of numbers.
    """
    values = series(x)
    ordered = np.sort(values[np.isfinite(values)])
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


def _z(fitted: Scaled, lsl: float | None, usl: float | None) -> tuple[float | None, float | None]:
    """Return the upper normal quantiles of the shares below and above the limits; None without a limit."""
    z_lsl = None if lsl is None else -float(normal_quantile(fitted.cdf(lsl), fitted.sf(lsl)))
    z_usl = None if usl is None else -float(normal_quantile(fitted.sf(usl), fitted.cdf(usl)))
    return z_lsl, z_usl


def normal_quantile(share: Array, rest: Array) -> Array:
    """Return the normal quantile of a share, computed from the smaller of the share and its complement."""
    return np.asarray(np.where(share < rest, ndtri(share), -ndtri(rest)))


def _of_z(z_lsl: Any, z_usl: Any) -> dict[str, Any]:
    """Return the indices from the Z-scores."""
    found = {}
    if z_lsl is not None:
        found["ppl"] = z_lsl / 3
    if z_usl is not None:
        found["ppu"] = z_usl / 3
    if z_lsl is not None and z_usl is not None:
        found["pp"] = (z_lsl + z_usl) / 6
    return found


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
    """Return the quantiles at the ranks ``p (n + 1)``, interpolated between neighbours (R's type 6).

    The values are ascending, shape (n,); a rank beyond the first or last value gives that value.
    """
    low, part = _ranks(ordered.size, shares)
    return _between(ordered[low - 1], ordered[np.minimum(low, ordered.size - 1)], part)


def quantile_interval(ordered: Array, share: float, confidence: float) -> Interval | None:
    """Return the two of the ascending values that enclose a quantile; None if the sample is too small for them.

    Each end misses the quantile with a probability of at most ``(1 - confidence) / 2``.
    """
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
    ordered: Array,
    shares: Sequence[float],
    statistics: Callable[[Array], dict[str, float]],
    confidence: float,
) -> dict[str, Interval]:
    """Return intervals of `statistics` of a few quantiles, by name; empty if the sample is too small.

    Each quantile is moved alone to both ends of its interval; the resulting changes of a statistic add as squares,
    upward and downward changes separately (Zou, Donner 2008).
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


def _ranks(n: int, shares: Sequence[float]) -> tuple[NDArray[np.int64], Array]:
    """Return the rank below each quantile, counted from 1, and the fraction of the distance to the next rank."""
    rank = np.clip(np.asarray(shares) * (n + 1), 1.0, float(n))
    low = np.floor(rank).astype(np.int64)
    return low, rank - low


def _between(low: Array, high: Array, part: Array) -> Array:
    """Return values interpolated between `low` and `high`."""
    return np.asarray(low + part * (high - low))
