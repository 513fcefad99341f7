"""Capability of one response: location, spread, indices with intervals, non-conforming share.

Formulas are those of the C-60 paper's appendix A (eqs. 28-30, Akhadkar, Acary, Brogliato 2018), which are the
Pp and Ppk of AIAG and ISO 22514-2: `sigma` is the overall standard deviation with divisor ``n - 1``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from reporting.errors import ReportError
from reporting.intervals import (
    Interval,
    cp_interval,
    cpk_interval,
    one_sided_interval,
    share_upper_bound,
)

PPM = 1e6
# A spread below this share of the largest value is the rounding of a constant, not a spread.
_ROUNDING = 8 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class Capability:
    """Capability of one response, in the unit of its values; None where a number is undefined.

    Attributes
    ----------
    n, dropped : int
        Finite values used, and values left out because they are not finite.
    lsl, usl, target : float or None
        Limits and target as given.
    confidence : float
        Confidence of intervals (two-sided) and of the ppm bounds (one-sided).
    mean, std, min, max, median : float or None
        Of the finite values; `std` is the overall one, divisor ``n - 1``.
    skewness, kurtosis : float or None
        Adjusted Fisher-Pearson skewness G1 and excess kurtosis G2 (0 for a normal distribution).
    cp, cpk, cpl, cpu, cc, cpm : float or None
        Indices. `cc` is signed: positive above the middle. `cpm` has divisor n around the target.
    cp_interval, cpk_interval, cpl_interval, cpu_interval : (float, float) or None
        Chi-square, Bissell, exact noncentral t, exact noncentral t.
    below, above : int or None
        Values under the lower and over the upper limit; a value on a limit conforms.
    ppm_observed, ppm_observed_below, ppm_observed_above : float or None
        Counted share out of limits, in parts per million.
    ppm_upper, ppm_upper_below, ppm_upper_above : float or None
        Clopper-Pearson upper bound of that share: what this many values can still not rule out.
    ppm_expected, ppm_expected_below, ppm_expected_above : float or None
        Share out of limits of a normal distribution with this mean and sigma.
    notes : tuple of str
        Why a number is None, and what to mind.
    """

    n: int
    dropped: int
    lsl: float | None
    usl: float | None
    target: float | None
    confidence: float
    mean: float | None = None
    std: float | None = None
    min: float | None = None
    max: float | None = None
    median: float | None = None
    skewness: float | None = None
    kurtosis: float | None = None
    cp: float | None = None
    cpk: float | None = None
    cpl: float | None = None
    cpu: float | None = None
    cc: float | None = None
    cpm: float | None = None
    cp_interval: Interval | None = None
    cpk_interval: Interval | None = None
    cpl_interval: Interval | None = None
    cpu_interval: Interval | None = None
    below: int | None = None
    above: int | None = None
    ppm_observed: float | None = None
    ppm_observed_below: float | None = None
    ppm_observed_above: float | None = None
    ppm_upper: float | None = None
    ppm_upper_below: float | None = None
    ppm_upper_above: float | None = None
    ppm_expected: float | None = None
    ppm_expected_below: float | None = None
    ppm_expected_above: float | None = None
    notes: tuple[str, ...] = ()


def capability(
    x: ArrayLike,
    lsl: float | None = None,
    usl: float | None = None,
    target: float | None = None,
    confidence: float = 0.95,
) -> Capability:
    """Return the capability of the values `x` against their limits.

    Parameters
    ----------
    x : array_like, shape (n,)
        Values of one response; values that are not finite are left out and counted.
    lsl, usl : float, optional
        Lower and upper specification limit, in the unit of `x`; None where that side is free.
    target : float, optional
        Wanted value, for Cpm.
    confidence : float
        Confidence of the intervals and bounds, between 0 and 1.

    Returns
    -------
    Capability

    Raises
    ------
    ReportError
        Limits crossed, equal or not finite; confidence outside (0, 1); values that are no series of numbers.
    """
    _check(lsl, usl, target, confidence)
    values = _series(x)
    finite = values[np.isfinite(values)]
    base: dict[str, object] = {
        "n": int(finite.size),
        "dropped": int(values.size - finite.size),
        "lsl": lsl,
        "usl": usl,
        "target": target,
        "confidence": confidence,
    }
    location = _location(finite)
    mean, std = location.get("mean"), location.get("std")
    spread = std if std is not None and std > 0 else None
    result = {
        **base,
        **location,
        **_indices(mean, spread, lsl, usl),
        **_intervals(int(finite.size), mean, spread, lsl, usl, confidence),
        "cpm": _cpm(finite, lsl, usl, target),
        **_observed(finite, lsl, usl, confidence),
        **_expected(mean, spread, lsl, usl),
        "notes": _notes(finite, int(values.size), spread, lsl, usl, target),
    }
    return Capability(**result)  # type: ignore[arg-type]


def _check(lsl: float | None, usl: float | None, target: float | None, confidence: float) -> None:
    """Raise ReportError if limits, target or confidence make no sense."""
    for name, value in (("lsl", lsl), ("usl", usl), ("target", target)):
        if value is not None and not math.isfinite(value):
            raise ReportError(f"{name} = {value}: must be a finite number; use None where there is no {name}")
    if lsl is not None and usl is not None and lsl >= usl:
        raise ReportError(f"lsl = {lsl:.15g} is not below usl = {usl:.15g}; exchange or correct the limits")
    if not 0 < confidence < 1:
        raise ReportError(f"confidence = {confidence}: must lie between 0 and 1, 0.95 is usual")


def _series(x: ArrayLike) -> NDArray[np.float64]:
    """Return `x` as a one-dimensional array of floats."""
    try:
        values = np.asarray(x, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ReportError(f"values are not numbers: {error}") from error
    if values.ndim != 1:
        raise ReportError(f"values have shape {values.shape}: one series of numbers is needed")
    return values


def _location(x: NDArray[np.float64]) -> dict[str, float]:
    """Return location, spread and shape as far as the number of values allows."""
    if x.size == 0:
        return {}
    low, high = float(x.min()), float(x.max())
    # The mean of equal values may round to a neighbour of them; it still lies between its extremes.
    mean = min(max(float(np.mean(x)), low), high)
    numbers = {"mean": mean, "min": low, "max": high, "median": float(np.median(x))}
    if x.size < 2:
        return numbers
    std = float(np.std(x, ddof=1))
    if low == high or std <= _ROUNDING * max(abs(low), abs(high)):
        return numbers | {"std": 0.0}
    return numbers | {"std": std} | _shape((x - mean) / std)


def _shape(z: NDArray[np.float64]) -> dict[str, float]:
    """Return adjusted skewness and excess kurtosis of standardised values (Joanes, Gill 1998: G1, G2)."""
    n, numbers = z.size, {}
    if n > 2:
        numbers["skewness"] = n / ((n - 1) * (n - 2)) * float(np.sum(z**3))
    if n > 3:
        third = n * (n + 1) / ((n - 1) * (n - 2) * (n - 3)) * float(np.sum(z**4))
        numbers["kurtosis"] = third - 3 * (n - 1) ** 2 / ((n - 2) * (n - 3))
    return numbers


def _indices(mean: float | None, std: float | None, lsl: float | None, usl: float | None) -> dict[str, float | None]:
    """Return Cp, Cpk, Cpl, Cpu (eqs. 28, 29) and Cc (eq. 30)."""
    cpl = (mean - lsl) / (3 * std) if mean is not None and std and lsl is not None else None
    cpu = (usl - mean) / (3 * std) if mean is not None and std and usl is not None else None
    sides = [side for side in (cpl, cpu) if side is not None]
    both = lsl is not None and usl is not None
    return {
        "cpl": cpl,
        "cpu": cpu,
        "cpk": min(sides) if sides else None,
        "cp": (usl - lsl) / (6 * std) if both and std else None,  # type: ignore[operator]
        "cc": (mean - (usl + lsl) / 2) / ((usl - lsl) / 2) if both and mean is not None else None,  # type: ignore[operator]
    }


def _intervals(
    n: int, mean: float | None, std: float | None, lsl: float | None, usl: float | None, confidence: float
) -> dict[str, Interval | None]:
    """Return the intervals of the indices that exist."""
    index = _indices(mean, std, lsl, usl)
    methods = {
        "cp": cp_interval,
        "cpk": cpk_interval,
        "cpl": one_sided_interval,
        "cpu": one_sided_interval,
    }
    return {
        f"{name}_interval": None if (value := index[name]) is None else method(value, n, confidence)
        for name, method in methods.items()
    }


def _cpm(x: NDArray[np.float64], lsl: float | None, usl: float | None, target: float | None) -> float | None:
    """Return Cpm, divisor n around the target; it needs both limits and values off the target."""
    if lsl is None or usl is None or target is None or x.size < 2:
        return None
    around_target = math.sqrt(float(np.mean((x - target) ** 2)))
    return (usl - lsl) / (6 * around_target) if around_target > 0 else None


def _observed(
    x: NDArray[np.float64], lsl: float | None, usl: float | None, confidence: float
) -> dict[str, float | int | None]:
    """Return counts out of limits, their ppm and upper bounds; the total is over the sides with a limit."""
    n = x.size
    if n == 0 or (lsl is None and usl is None):
        return {}
    below = int(np.count_nonzero(x < lsl)) if lsl is not None else None
    above = int(np.count_nonzero(x > usl)) if usl is not None else None
    counts = {"_below": below, "_above": above, "": (below or 0) + (above or 0)}
    numbers: dict[str, float | int | None] = {"below": below, "above": above}
    for side, count in counts.items():
        if count is not None:
            numbers[f"ppm_observed{side}"] = PPM * count / n
            numbers[f"ppm_upper{side}"] = PPM * share_upper_bound(count, n, confidence)
    return numbers


def _expected(mean: float | None, std: float | None, lsl: float | None, usl: float | None) -> dict[str, float]:
    """Return the ppm of a normal distribution per side that has a limit, and their sum."""
    if mean is None or std is None or (lsl is None and usl is None):
        return {}
    numbers = {}
    if lsl is not None:
        numbers["ppm_expected_below"] = PPM * float(ndtr((lsl - mean) / std))
    if usl is not None:
        numbers["ppm_expected_above"] = PPM * float(ndtr((mean - usl) / std))
    return numbers | {"ppm_expected": sum(numbers.values())}


def _notes(
    finite: NDArray[np.float64],
    size: int,
    spread: float | None,
    lsl: float | None,
    usl: float | None,
    target: float | None,
) -> tuple[str, ...]:
    """Return why numbers are missing."""
    has_limit = lsl is not None or usl is not None
    notes: Sequence[tuple[bool, str]] = (
        (size > finite.size, f"{size - finite.size} of {size} values are not finite and were left out."),
        (finite.size == 0, "No values: nothing can be said."),
        (finite.size == 1, "One value only: no spread, so no index."),
        (
            finite.size > 1 and spread is None,
            "All values are equal: zero spread, so no index and no expected ppm.",
        ),
        (not has_limit, "No limits: no index and no share out of limits."),
        (has_limit and usl is None, "Lower limit only: Cp, Cc and Cpm are undefined, Cpk is Cpl."),
        (has_limit and lsl is None, "Upper limit only: Cp, Cc and Cpm are undefined, Cpk is Cpu."),
        (lsl is not None and usl is not None and target is None, "No target: Cpm is undefined."),
    )
    return tuple(text for holds, text in notes if holds)
