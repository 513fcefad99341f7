"""Capability of a response that is not normal, by three methods.

- Percentile method (Clements 1989, ISO 22514-2): the 0.135 %, 50 % and 99.865 % quantiles of the fitted distribution
  replace mean and six sigma.
- Z-score method (Minitab's default): the normal quantiles of the shares of the fitted distribution out of limits.
  After a Box-Cox, Yeo-Johnson or Johnson transformation this is the capability of the transformed values within the
  transformed limits, and the percentiles are the +-3 sigma limits transformed back.
- Empirical percentiles (Cnpk): quantiles of the values themselves, at the ranks ``p (n + 1)`` (R's type 6).

Intervals of the fitted methods follow from the curvature of the likelihood (delta method) and hold if the family is
right. Those of the empirical method are bootstrap intervals (`reporting.shape.order_statistics`).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval, bench
from reporting.capability.moments import series
from reporting.capability.shares import PPM
from reporting.shape.families import Scaled
from reporting.shape.fitting import Fit, distribution
from reporting.shape.order_statistics import FEWEST, empirical_percentiles, percentile_bootstrap

# Probabilities of the lower end, the middle and the upper end of a process (ISO 22514-2): -3, 0 and 3 normal sigmas.
ENDS = (0.00135, 0.5, 0.99865)
_STEP = 1e-4


@dataclass(frozen=True)
class NonnormalIndices:
    """Indices of one method; None where undefined.

    Attributes
    ----------
    method : str
        "percentile", "z_score" or "empirical".
    family : str or None
        Fitted family; None for the empirical method.
    assumed : str
        The assumption, in one sentence.
    pp, ppk, ppl, ppu : float or None
        In the place of Cp, Cpk, Cpl, Cpu.
    pp_interval, ppk_interval, ppl_interval, ppu_interval : (float, float) or None
        Two-sided.
    percentiles : (float, float, float) or None
        Quantiles at `ENDS`, in the unit of the values.
    z_lsl, z_usl, z_bench : float or None
        Normal quantiles of the shares out of limits, for the fitted methods.
    ppm_expected, ppm_expected_below, ppm_expected_above : float or None
        Share of the fitted distribution out of limits; None for the empirical method.
    notes : tuple of str
        Why a number is None.
    """

    method: str
    family: str | None
    assumed: str
    pp: float | None = None
    ppk: float | None = None
    ppl: float | None = None
    ppu: float | None = None
    pp_interval: Interval | None = None
    ppk_interval: Interval | None = None
    ppl_interval: Interval | None = None
    ppu_interval: Interval | None = None
    percentiles: tuple[float, float, float] | None = None
    z_lsl: float | None = None
    z_usl: float | None = None
    z_bench: float | None = None
    ppm_expected: float | None = None
    ppm_expected_below: float | None = None
    ppm_expected_above: float | None = None
    notes: tuple[str, ...] = ()


def fitted_indices(
    method: str, fit: Fit, lsl: float | None, usl: float | None, confidence: float = 0.95
) -> NonnormalIndices:
    """Return the indices of the percentile or the Z-score method from a fitted distribution.

    Parameters
    ----------
    method : str
        "percentile" or "z_score".
    fit : Fit
        Of `reporting.shape.fits.fit_families`.
    lsl, usl : float or None
        Limits, in the unit of the values.
    confidence : float
        Of the two-sided intervals.
    """

    def indices(of: Scaled) -> dict[str, Any]:
        return _of_percentiles(of.ppf(ENDS), lsl, usl) if method == "percentile" else _of_z(*_z(of, lsl, usl))

    fitted = distribution(fit)
    with np.errstate(all="ignore"):
        point = _finite(indices(fitted))
        z_lsl, z_usl = _z(fitted, lsl, usl)
        ends = fitted.ppf(ENDS)
    below = None if lsl is None else PPM * float(fitted.cdf(lsl))
    above = None if usl is None else PPM * float(fitted.sf(usl))
    sides = [share for share in (below, above) if share is not None]
    unbounded = any(z is not None and not math.isfinite(z) for z in (z_lsl, z_usl))
    notes = (
        ["A limit lies outside the range of the fitted distribution, so there is no Z-score at this limit."]
        if unbounded
        else []
    )
    intervals: dict[str, Any] = {}
    if fit.covariance is None:
        notes.append("The values do not determine each parameter of the fit by itself, so there is no interval.")
    else:
        intervals = _delta_intervals(fit, indices, point, confidence)
    return NonnormalIndices(
        method,
        fit.family,
        f"Assumed: the response follows the fitted distribution ({fit.title}), also beyond its extreme values.",
        **_with_ppk(point),
        **intervals,
        percentiles=(float(ends[0]), float(ends[1]), float(ends[2])) if np.all(np.isfinite(ends)) else None,
        z_lsl=z_lsl if z_lsl is None or math.isfinite(z_lsl) else None,
        z_usl=z_usl if z_usl is None or math.isfinite(z_usl) else None,
        z_bench=None if unbounded else bench(z_lsl, z_usl),
        ppm_expected=sum(sides) if sides else None,
        ppm_expected_below=below,
        ppm_expected_above=above,
        notes=tuple(notes),
    )


def empirical_indices(x: ArrayLike, lsl: float | None, usl: float | None, confidence: float = 0.95) -> NonnormalIndices:
    """Return the indices from the percentiles of the values themselves (Cnpk), with BCa bootstrap intervals.

    Parameters
    ----------
    x : array_like, shape (n,)
        Values; those that are not finite are left out.
    lsl, usl : float or None
        Limits, in the unit of the values.
    confidence : float
        Of the two-sided intervals.

    Raises
    ------
    ReportError
        `x` is not a series of numbers.
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
        notes += (f"{ordered.size} values: the 0.135 % percentiles are the extreme values; the indices are too large.",)
    if ordered.size < FEWEST:
        notes += (f"{ordered.size} values are too few for an interval of a 0.135 % percentile: {FEWEST} are needed.",)
    else:
        bounds = percentile_bootstrap(ordered, ENDS, lambda q: _of_percentiles(q, lsl, usl), confidence)
        intervals = {f"{name}_interval": bounds.get(name) for name in ("pp", "ppl", "ppu")}
        intervals["ppk_interval"] = intervals[f"{_binding(point)}_interval"] if point else None
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
    """Return the indices of three percentiles, shape (3,), or of many such triples, shape (3, m)."""
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
    z_lsl = None if lsl is None else -_quantile(float(fitted.cdf(lsl)), float(fitted.sf(lsl)))
    z_usl = None if usl is None else -_quantile(float(fitted.sf(usl)), float(fitted.cdf(usl)))
    return z_lsl, z_usl


def _quantile(share: float, rest: float) -> float:
    """Return the normal quantile of a share, computed from the smaller of the share and its complement."""
    return float(ndtri(share) if share < rest else -ndtri(rest))


def _of_z(z_lsl: float | None, z_usl: float | None) -> dict[str, float]:
    """Return the indices of the Z-scores."""
    indices = {}
    if z_lsl is not None:
        indices["ppl"] = z_lsl / 3
    if z_usl is not None:
        indices["ppu"] = z_usl / 3
    if z_lsl is not None and z_usl is not None:
        indices["pp"] = (z_lsl + z_usl) / 6
    return indices


def _delta_intervals(
    fit: Fit, indices: Callable[[Scaled], dict[str, float]], point: dict[str, float], confidence: float
) -> dict[str, Any]:
    """Return the intervals of the indices by the delta method, from the covariance of theta."""
    covariance = np.asarray(fit.covariance)
    slopes: dict[str, list[float]] = {name: [] for name in point}
    with np.errstate(all="ignore"):
        for i, value in enumerate(fit.theta):
            step = _STEP * math.sqrt(covariance[i, i]) + 1e-9
            up, down = (
                indices(distribution(fit, (*fit.theta[:i], value + move, *fit.theta[i + 1 :])))
                for move in (step, -step)
            )
            for name, slope in slopes.items():
                slope.append((up[name] - down[name]) / (2 * step))
    z = float(ndtri(0.5 + confidence / 2))
    intervals: dict[str, Any] = {}
    for name, slope in slopes.items():
        half = z * math.sqrt(max(float(np.asarray(slope) @ covariance @ np.asarray(slope)), 0.0))
        intervals[f"{name}_interval"] = (point[name] - half, point[name] + half) if math.isfinite(half) else None
    if point:
        intervals["ppk_interval"] = intervals.get(f"{_binding(point)}_interval")
    return intervals


def _binding(point: dict[str, float]) -> str:
    """Return the name of the smaller one-sided index, which is Ppk."""
    return min((name for name in ("ppl", "ppu") if name in point), key=lambda name: point[name], default="pp")


def _finite(point: dict[str, float]) -> dict[str, float]:
    """Return the indices that are finite."""
    return {name: float(value) for name, value in point.items() if math.isfinite(value)}


def _with_ppk(point: dict[str, float]) -> dict[str, Any]:
    """Return the indices with Ppk, the smaller one-sided index."""
    sides = [point[name] for name in ("ppl", "ppu") if name in point]
    return point | {"ppk": min(sides)} if sides else point
