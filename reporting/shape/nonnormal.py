"""Capability of a response that is not normal: by percentiles, by Z-scores, without a distribution.

- Percentile method (Clements 1989, ISO 22514-2): the 0.135 %, 50 % and 99.865 % quantiles of the fitted distribution
  take the place of mean and six sigma.
- Z-score method (Minitab's default): the normal quantiles of the shares that the fitted distribution puts out of
  limits. After Box-Cox, Yeo-Johnson or Johnson this is the capability of the transformed values in their
  transformed limits, and the percentiles are its +-3 sigma limits transformed back.
- Empirical percentiles (Cnpk): the quantiles of the values themselves, at ``p (n + 1)`` (R's type 6).

Intervals of the fitted methods follow from the curvature of the likelihood (delta method): they hold if the family is
right. Those of the empirical one are in `reporting.shape.order_statistics`.
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
from reporting.shape.families import Scaled, Theta
from reporting.shape.fits import Fit, distribution
from reporting.shape.order_statistics import FEWEST, empirical_percentiles, percentile_bootstrap

# Shares below, at and above which ISO 22514-2 sets the ends of a process: those of -3, 0 and 3 normal sigmas.
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
        Family of the fit; None for the empirical method.
    assumed : str
        What the numbers rest on, one sentence.
    pp, ppk, ppl, ppu : float or None
        In place of the paper's Cp, Cpk, Cpl, Cpu.
    pp_interval, ppk_interval, ppl_interval, ppu_interval : (float, float) or None
        Two-sided.
    percentiles : (float, float, float) or None
        Quantiles at `ENDS`, in the unit of the values.
    z_lsl, z_usl, z_bench : float or None
        Normal quantiles of the shares outside (fitted methods).
    ppm_expected, ppm_expected_below, ppm_expected_above : float or None
        Share of the fitted distribution out of limits; for the empirical method see `reporting.capability.shares`.
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


def percentile_indices(fit: Fit, lsl: float | None, usl: float | None, confidence: float = 0.95) -> NonnormalIndices:
    """Return the indices of the percentile method from a fitted distribution.

    Parameters
    ----------
    fit : Fit
        Of `reporting.shape.fits.fit_families`.
    lsl, usl : float or None
        Limits, in the unit of the values.
    confidence : float
        Of the two-sided intervals.
    """
    return _fitted("percentile", fit, lsl, usl, confidence, lambda d: _of_percentiles(d.ppf(ENDS), lsl, usl))


def z_score_indices(fit: Fit, lsl: float | None, usl: float | None, confidence: float = 0.95) -> NonnormalIndices:
    """Return the indices of the Z-score method from a fitted distribution.

    Parameters
    ----------
    fit : Fit
        Of `reporting.shape.fits.fit_families`.
    lsl, usl : float or None
        Limits, in the unit of the values.
    confidence : float
        Of the two-sided intervals.
    """
    return _fitted("z_score", fit, lsl, usl, confidence, lambda d: _of_z(*_z(d, lsl, usl)))


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
        `x` is no series of numbers.
    """
    values = series(x)
    ordered = np.sort(values[np.isfinite(values)])
    assumed = "No distribution: the percentiles are those of the values, and hold no more than the values do."
    if ordered.size < 2 or ordered[0] == ordered[-1]:
        return NonnormalIndices("empirical", None, assumed, notes=("Fewer than two values that differ: no index.",))
    ends = empirical_percentiles(ordered, ENDS)
    with np.errstate(all="ignore"):  # percentiles that coincide
        point = _finite(_of_percentiles(ends, lsl, usl))
    notes: tuple[str, ...] = ()
    if ends[0] == ends[1] or ends[1] == ends[2]:
        notes = ("Most values are equal: percentiles coincide, so an index is missing.",)
    intervals: dict[str, Any] = {}
    if ordered.size * ENDS[0] < 1:
        notes += (f"{ordered.size} values: the 0.135 % percentiles are the extreme values, the indices too large.",)
    if ordered.size < FEWEST:
        notes += (f"{ordered.size} values do not bound a 0.135 % percentile: no interval below {FEWEST} values.",)
    else:
        draws = percentile_bootstrap(ordered, ENDS, lambda q: _of_percentiles(q, lsl, usl), confidence)
        intervals = {f"{name}_interval": draws.get(name) for name in ("pp", "ppl", "ppu")}
        intervals["ppk_interval"] = intervals[f"{_binding(point)}_interval"] if point else None
    return NonnormalIndices(
        "empirical",
        None,
        assumed,
        **_numbers(point),
        **intervals,
        percentiles=(float(ends[0]), float(ends[1]), float(ends[2])),
        notes=notes,
    )


def _fitted(
    method: str,
    fit: Fit,
    lsl: float | None,
    usl: float | None,
    confidence: float,
    indices: Callable[[Scaled], dict[str, float]],
) -> NonnormalIndices:
    """Return the indices of a method that needs a fitted distribution."""
    found = distribution(fit)
    with np.errstate(all="ignore"):
        point = _finite(indices(found))
        z_lsl, z_usl = _z(found, lsl, usl)
        ends = found.ppf(ENDS)
    below = None if lsl is None else PPM * float(found.cdf(lsl))
    above = None if usl is None else PPM * float(found.sf(usl))
    sides = [share for share in (below, above) if share is not None]
    z_sides = [None if z is None or not math.isfinite(z) else z for z in (z_lsl, z_usl)]
    missing = [z is not None and kept is None for z, kept in zip((z_lsl, z_usl), z_sides, strict=True)]
    notes = [] if not any(missing) else ["A limit lies where the fitted distribution has no value: no Z-score there."]
    intervals: dict[str, Any] = {} if fit.covariance is None else _delta(fit, indices, point, confidence)
    if fit.covariance is None:
        notes.append("The parameters of the fit are not separately determined: no interval.")
    return NonnormalIndices(
        method,
        fit.family,
        f"The response follows the fitted distribution ({fit.title}), also beyond its extreme values.",
        **_numbers(point),
        **intervals,
        percentiles=(float(ends[0]), float(ends[1]), float(ends[2])) if np.all(np.isfinite(ends)) else None,
        z_lsl=z_sides[0],
        z_usl=z_sides[1],
        z_bench=None if any(missing) else bench(z_lsl, z_usl),
        ppm_expected=sum(sides) if sides else None,
        ppm_expected_below=below,
        ppm_expected_above=above,
        notes=tuple(notes),
    )


def _of_percentiles(ends: Array, lsl: float | None, usl: float | None) -> dict[str, Any]:
    """Return the indices of the three percentiles, shape (3,), or of many such triples, shape (3, m)."""
    low, median, high = ends
    found = {}
    if lsl is not None:
        found["ppl"] = (median - lsl) / (median - low)
    if usl is not None:
        found["ppu"] = (usl - median) / (high - median)
    if lsl is not None and usl is not None:
        found["pp"] = (usl - lsl) / (high - low)
    return found


def _z(found: Scaled, lsl: float | None, usl: float | None) -> tuple[float | None, float | None]:
    """Return the normal quantiles of the shares below and above the limits, positive where the limit is kept."""
    z_lsl = None if lsl is None else -_quantile(float(found.cdf(lsl)), float(found.sf(lsl)))
    z_usl = None if usl is None else -_quantile(float(found.sf(usl)), float(found.cdf(usl)))
    return z_lsl, z_usl


def _quantile(share: float, rest: float) -> float:
    """Return the normal quantile of a share, from the smaller of it and the rest."""
    return float(ndtri(share) if share < rest else -ndtri(rest))


def _of_z(z_lsl: float | None, z_usl: float | None) -> dict[str, float]:
    """Return the indices of the Z-scores."""
    found = {}
    if z_lsl is not None:
        found["ppl"] = z_lsl / 3
    if z_usl is not None:
        found["ppu"] = z_usl / 3
    if z_lsl is not None and z_usl is not None:
        found["pp"] = (z_lsl + z_usl) / 6
    return found


def _delta(
    fit: Fit, indices: Callable[[Scaled], dict[str, float]], point: dict[str, float], confidence: float
) -> dict[str, Any]:
    """Return the intervals of the indices by the delta method: slopes by theta, and theta's covariance."""
    covariance = np.asarray(fit.covariance)
    slopes: dict[str, list[float]] = {name: [] for name in point}
    with np.errstate(all="ignore"):
        for i, value in enumerate(fit.theta):
            step = _STEP * math.sqrt(covariance[i, i]) + 1e-9
            up, down = (indices(distribution(fit, _moved(fit.theta, i, value + move))) for move in (step, -step))
            for name, slope in slopes.items():
                slope.append((up[name] - down[name]) / (2 * step))
    z = float(ndtri(0.5 + confidence / 2))
    found: dict[str, Any] = {}
    for name, slope in slopes.items():
        half = z * math.sqrt(max(float(np.asarray(slope) @ covariance @ np.asarray(slope)), 0.0))
        found[f"{name}_interval"] = (point[name] - half, point[name] + half) if math.isfinite(half) else None
    if point:
        found["ppk_interval"] = found.get(f"{_binding(point)}_interval")
    return found


def _moved(theta: Theta, i: int, value: float) -> Theta:
    return (*theta[:i], value, *theta[i + 1 :])


def _binding(point: dict[str, float]) -> str:
    """Return the side whose index is Ppk."""
    return min((name for name in ("ppl", "ppu") if name in point), key=lambda name: point[name], default="pp")


def _finite(point: dict[str, float]) -> dict[str, float]:
    """Return the indices that are numbers."""
    return {name: float(value) for name, value in point.items() if math.isfinite(value)}


def _numbers(point: dict[str, float]) -> dict[str, Any]:
    """Return the indices with Ppk, their least side."""
    sides = [point[name] for name in ("ppl", "ppu") if name in point]
    return point | {"ppk": min(sides)} if sides else point
