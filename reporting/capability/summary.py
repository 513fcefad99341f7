"""Capability of one response: location, spread, indices with intervals, non-conforming share.

Formulas are from appendix A of the C-60 paper (eqs. 28-30, Akhadkar, Acary, Brogliato 2018): sigma is the overall
standard deviation with divisor ``n - 1``, so that Cp and Cpk are the Pp and Ppk of AIAG and ISO 22514-2. If the
production batch of each value is given, the indices with the sigma within batches (AIAG's Cp and Cpk) are added.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from reporting.arrays import ROUNDING, Array, magnitude, sums
from reporting.capability.indices import SIX_SIGMA_SHIFT, centring, distance_to_limit, point_indices
from reporting.capability.interval_choice import Fence, Method, Values, choose_method, index_intervals
from reporting.capability.intervals import Interval
from reporting.capability.lots import FEW_LOTS, Lots, describe_lots, independent, mean_error
from reporting.capability.row_order import RowOrder, row_order
from reporting.capability.shares import expected_normal, nonconforming, ppm_of_z
from reporting.capability.within import Within, within
from reporting.errors import (
    check_limits,
    finite_in_order,
    finite_or_none,
    production_batches,
    real_number,
    series,
)

NOT_NORMAL = (
    "Skewness and kurtosis of these values contradict a normal distribution, so the ppm expected of one has no "
    "interval: the true share may lie anywhere."
)
_NO_INDEX = "no index and no expected ppm"
_TOO_LARGE = "The values are too large to be squared, so there is no spread and no index."
NO_WITHIN = "No batch has two different values, so there is no sigma and no index within batches."


@dataclass(frozen=True)
class Capability:
    """Capability of one response, in the unit of its values; None where a number is undefined.

    Attributes
    ----------
    n, dropped : int
        Number of finite values, and number of values left out because they are not finite.
    lsl, usl, target : float or None
        Limits and target as given.
    confidence : float
        Confidence of intervals (two-sided) and of the ppm bounds (one-sided).
    mean, std, min, max, median : float or None
        Statistics of the finite values; `std` is the overall one with divisor ``n - 1``.
    skewness, kurtosis : float or None
        Adjusted Fisher-Pearson skewness G1 and excess kurtosis G2 (0 for a normal distribution).
    cp, cpk, cpl, cpu, cc, cpm : float or None
        Indices. `cc` is signed: positive above the middle. `cpm` has the divisor n.
    mean_interval, std_interval : (float, float) or None
        Intervals of mean and standard deviation.
    cp_interval, cpk_interval, cpl_interval, cpu_interval, cc_interval, cpm_interval : (float, float) or None
        Intervals by the method `interval_method`; the interval of Cpk is the one of the nearer side.
    cpk_interval_joint : (float, float) or None
        Interval of Cpk whose coverage is at least the stated one, wherever the mean lies between the limits; with one
        limit the interval of that side.
    z_lsl, z_usl, z_bench : float or None
        Distance to each limit in sigmas, and the normal quantile of the total share out of limits.
    z_bench_interval : (float, float) or None
        Interval by the same method. The intervals of `z_lsl` and `z_usl` are three times those of `cpl` and `cpu`.
    sigma_level : float or None
        ``z_bench + 1.5``, as in Six Sigma tables, where 3.4 ppm is 6 sigma.
    below, above : int or None
        Number of values below the lower and above the upper limit; a value on a limit conforms.
    ppm_observed, ppm_observed_below, ppm_observed_above : float or None
        Counted share out of limits, in parts per million.
    ppm_upper, ppm_upper_below, ppm_upper_above : float or None
        Clopper-Pearson upper bound of that share; with lots, for the effective number of independent values.
    ppm_expected, ppm_expected_below, ppm_expected_above : float or None
        Share out of limits of a normal distribution with this mean and sigma.
    ppm_expected_interval : (float, float) or None
        Interval of the total, from the interval of `z_bench`; None where skewness or kurtosis prove that the values are
        not normal.
    interval_method : str
        "normal theory", "own moments" (of the values) or "production lots"; empty where there are no intervals.
    interval_reason : str
        Why this method was chosen, or why there are no intervals; limitations of the method.
    lots : Lots or None
        The production lots of the values; None if the values are independent.
    within : Within or None
        Indices with the sigma within production batches; None without batches.
    order : RowOrder or None
        Whether the values drift or resemble their neighbours; None where their order means nothing, or too few differ.
    notes : tuple of str
        Why a number is None, and cautions.
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
    mean_interval: Interval | None = None
    std_interval: Interval | None = None
    cp_interval: Interval | None = None
    cpk_interval: Interval | None = None
    cpl_interval: Interval | None = None
    cpu_interval: Interval | None = None
    cpk_interval_joint: Interval | None = None
    cc_interval: Interval | None = None
    cpm_interval: Interval | None = None
    z_lsl: float | None = None
    z_usl: float | None = None
    z_bench: float | None = None
    z_bench_interval: Interval | None = None
    sigma_level: float | None = None
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
    ppm_expected_interval: Interval | None = None
    interval_method: str = ""
    interval_reason: str = ""
    lots: Lots | None = None
    within: Within | None = None
    order: RowOrder | None = None
    notes: tuple[str, ...] = ()


def capability(
    x: "ArrayLike",  # in quotes, because its name says more than the 900 characters that it stands for
    lsl: float | None = None,
    usl: float | None = None,
    target: float | None = None,
    confidence: float = 0.95,
    batches: "ArrayLike | None" = None,
    lots: "ArrayLike | None" = None,
    *,
    ordered: bool = True,
) -> Capability:
    """Return the capability of the values `x` against their limits.

    Parameters
    ----------
    x : array_like, shape (n,)
        Values of one response, in the order in which the parts were made; values that are not finite are left out and
        counted.
    lsl, usl : float, optional
        Lower and upper specification limit, in the unit of `x`; None for a side without a limit.
    target : float, optional
        Target value, for Cpm.
    confidence : float
        Confidence of the intervals and bounds, between 0 and 1.
    batches : array_like, shape (n,), optional
        Production batch (lot) of each value, as numbers or names, for the sigma within. Values of a batch share a
        shift, so the intervals are based on the differences between batches.
    lots : array_like, shape (n,), optional
        Groups of batches that share no shift, if values of different batches may share one. Default: `batches`.

    ordered : bool
        Whether the order of the values means something. If it does, a note says where they drift or resemble their
        neighbours, because the intervals are too narrow then. False for values that are sorted, or drawn at random.

    Returns
    -------
    Capability

    Raises
    ------
    ReportError
        If a limit or the target is not a finite number; the limits are crossed, equal, or too close to or too far from
        each other for doubles; the confidence is not between 0 and 1; the values are not a one-dimensional series of
        numbers; or the number of batches or lots differs from the number of values.
    """
    return capability_and_values(x, lsl, usl, target, confidence, batches, lots, ordered=ordered)[0]


def capability_and_values(
    x: ArrayLike,
    lsl: float | None,
    usl: float | None,
    target: float | None,
    confidence: float,
    batches: ArrayLike | None,
    lots: ArrayLike | None,
    *,
    ordered: bool,
) -> tuple[Capability, Values]:
    """Return what `capability` does, and the finite values with what was computed of them."""
    lsl, usl, target = (finite_or_none(*given) for given in (("lsl", lsl), ("usl", usl), ("target", target)))
    confidence = real_number("confidence", confidence)
    check_limits(lsl, usl, confidence)
    values = series(x)
    groups = production_batches(batches, values.size)
    lot_of = groups if lots is None else production_batches(lots, values.size)
    is_finite = np.isfinite(values)
    finite = values if is_finite.all() else values[is_finite]
    known = Values(finite, finite_in_order(finite))
    lot_of = None if lot_of is None or independent(lot_of[is_finite]) else lot_of[is_finite]
    with np.errstate(over="ignore", invalid="ignore"):  # squares may overflow: such results become None
        mean, std = known.location.get("mean"), known.location.get("std")
        spread = std if std is not None and math.isfinite(std) and std > 0 else None
        described = None if lot_of is None else describe_lots(finite, lot_of)
        method, intervals = Method("", "", normal=True), dict[str, Interval | None]()
        if spread is not None:
            method = choose_method(known, described)
            intervals = index_intervals(method, known, Fence(lsl, usl, target, confidence), lot_of)
        order = row_order(finite, lot_of) if ordered and spread is not None else None
        within_batches = None
        if groups is not None and spread is not None:
            within_batches = within(finite, groups[is_finite], lsl, usl, confidence)
        numbers = {
            **known.location,
            "cc": centring(mean, lsl, usl),
            **_normal_indices(mean, spread, lsl, usl),
            **_cpm(finite, mean, lsl, usl, target),
            **_observed(finite, lsl, usl, confidence, lot_of),
            **intervals,
        }
        z_bench = intervals.get("z_bench_interval")
        if z_bench is not None and method.normal:
            numbers["ppm_expected_interval"] = ppm_of_z(z_bench[1]), ppm_of_z(z_bench[0])
    numbers_of_x = Capability(
        n=int(finite.size),
        dropped=int(values.size - finite.size),
        lsl=lsl,
        usl=usl,
        target=target,
        confidence=confidence,
        **{name: value for name, value in numbers.items() if _representable(value)},  # type: ignore[arg-type]
        interval_method=method.name,
        interval_reason=method.reason,
        lots=described,
        within=within_batches,
        order=order,
        notes=(
            *why_missing(finite, int(values.size), std, (lsl, usl, target)),
            *([] if method.normal or (lsl is None and usl is None) else [NOT_NORMAL]),
            *([order.finding] if order is not None and order.finding else []),
            *([NO_WITHIN] if groups is not None and spread is not None and within_batches is None else []),
        ),
    )
    return numbers_of_x, known


def why_missing(
    finite: Array, size: int, std: float | None, limits: tuple[float | None, float | None, float | None]
) -> tuple[str, ...]:
    """Return why numbers are missing; `size` counts all values, `limits` are lower limit, upper limit and target."""
    lsl, usl, target = limits
    has_limit = lsl is not None or usl is not None
    notes: Sequence[tuple[bool, str]] = (
        (size > finite.size, f"{size - finite.size} of {size} values are not finite and were left out."),
        (finite.size == 0, "No values."),
        (finite.size == 1, "One value has no spread, so there is no index."),
        (finite.size > 1 and std == 0, f"All values are equal: the spread is zero, so there is {_NO_INDEX}."),
        (std is not None and not math.isfinite(std), _TOO_LARGE),
        (not has_limit, "Without limits there is no index and no share out of limits."),
        (has_limit and usl is None, "Lower limit only: Cp, Cc and Cpm are undefined; Cpk is Cpl."),
        (has_limit and lsl is None, "Upper limit only: Cp, Cc and Cpm are undefined; Cpk is Cpu."),
        (lsl is not None and usl is not None and target is None, "Without a target Cpm is undefined."),
    )
    return tuple(text for holds, text in notes if holds)


def _representable(value: object) -> bool:
    """Return whether every number of a result is finite; a result that is not finite becomes None."""
    numbers = value if isinstance(value, tuple) else (value,)
    return all(number is not None and math.isfinite(number) for number in numbers)


def _normal_indices(
    mean: float | None, std: float | None, lsl: float | None, usl: float | None
) -> dict[str, float | Interval | None]:
    if mean is None or std is None:
        return {}
    index = point_indices(mean, std, lsl, usl)
    z, expected = index["z_bench"], expected_normal(mean, std, lsl, usl)
    shares = {"total": "ppm_expected", "below": "ppm_expected_below", "above": "ppm_expected_above"}
    of_shares = {shares[side]: share for side, share in expected.items()}
    return {**index, "sigma_level": None if z is None else z + SIX_SIGMA_SHIFT, **of_shares}


def _cpm(x: Array, mean: float | None, lsl: float | None, usl: float | None, target: float | None) -> dict[str, float]:
    """Return Cpm with divisor n; it needs both limits, and values that differ from the target."""
    if mean is None or lsl is None or usl is None or target is None or x.size < 2:
        return {}
    around_target = _around(x, target)
    return {"cpm": (usl - lsl) / (6 * around_target)} if 0 < around_target < math.inf else {}


def _around(x: Array, target: float) -> float:
    """Return the root mean square of values around a target."""
    return math.sqrt(sums(x, lambda piece: (np.square(piece - target),))[0] / x.size)


def _observed(
    x: Array, lsl: float | None, usl: float | None, confidence: float, lots: NDArray[np.generic] | None
) -> dict[str, float | int | None]:
    """Return counts out of limits, their ppm and upper bounds; the total covers the sides with a limit."""
    shares = nonconforming(x, lsl, usl, confidence, lots=lots)
    if shares is None:
        return {}
    numbers: dict[str, float | int | None] = {"ppm_observed": shares.total.ppm, "ppm_upper": shares.total.upper}
    for side, share in (("below", shares.below), ("above", shares.above)):
        if share is not None:
            numbers |= {side: share.count, f"ppm_observed_{side}": share.ppm, f"ppm_upper_{side}": share.upper}
    return numbers


# The values at hand beside the mean and sigma that the process is known to have.
#
# A process that has run for years has a mean and a sigma that one sample does not overrule. The indices with both say
# what is promised on that ground; the intervals of the differences say whether these values still agree with it.


@dataclass(frozen=True)
class Historical:
    """Indices with the historical mean and sigma, and how far the values are from both."""

    mean: float  # as given, in the unit of the response
    sigma: float
    cp: float | None  # None where a limit is missing
    cpk: float | None
    shift: float | None  # mean of the values less the historical mean, in the unit of the response
    shift_interval: Interval | None  # None where the mean has no interval
    ratio: float | None  # standard deviation of the values by the historical sigma
    ratio_interval: Interval | None
    finding: str  # what contradicts the historical values at the stated confidence; empty if nothing does


def historical(numbers: Capability, mean: float | None, sigma: float | None) -> Historical | None:
    """Return the capability with the historical mean and sigma (above 0), and the differences; None without them."""
    if mean is None or sigma is None:
        return None
    index = point_indices(mean, sigma, numbers.lsl, numbers.usl)
    shift = None if numbers.mean is None else numbers.mean - mean
    ratio = None if numbers.std is None else numbers.std / sigma
    of_mean, of_std = numbers.mean_interval, numbers.std_interval
    between = None if of_mean is None else (of_mean[0] - mean, of_mean[1] - mean)
    times = None if of_std is None else (of_std[0] / sigma, of_std[1] / sigma)
    contradicted = [
        f"the historical {what}"
        for interval, agreed, what in ((between, 0.0, "mean"), (times, 1.0, "sigma"))
        if interval is not None and not interval[0] <= agreed <= interval[1]
    ]
    finding = ""
    if contradicted:
        finding = (
            f"These values contradict {' and '.join(contradicted)} at {100 * numbers.confidence:g} % confidence: the"
            " process has changed, or they are not of this process. The indices with the historical values do not"
            " describe them."
        )
    return Historical(mean, sigma, index["cp"], index["cpk"], shift, between, ratio, times, finding)


# Indices around a target that need not be the middle of the limits; one limit is enough.
#
# All are divided by ``tau``, the root mean square around the target T: ``tau^2 = mean((x - T)^2)``, divisor n.
#
# - Cpm* is ``min(USL - T, T - LSL) / (3 tau)`` (Chan, Cheng, Spiring 1988): the nearer limit counts, so Cpm* equals Cpm
#   if the target is the middle, and is smaller otherwise. With one limit it is the index of that side, as in Minitab.
# - Cpmk is ``min(USL - m, m - LSL) / (3 tau)`` (Pearn, Kotz, Johnson 1992), also named Cpkm; with one limit it is the
#   index of that side, ``C_pa(0, 1)`` of Vännman (1998). With two limits it is ``Cpk Cpm / Cp``.
#
# The interval of Cpm* is that of Cpm with limits as far from the target as the nearer limit
# (`reporting.capability.interval_choice`). The interval of Cpmk follows from its influence function, with Student's
# quantile for the degrees of freedom of its spread. Measured coverage of 95 % intervals of Cpmk at n = 500 and 5,000,
# target 0 and 0.7 sigma off, for six shapes: 91 to 97 %; at n = 50: 84 to 95 %, so it is given for 100 values or more.

FEWEST_FOR_CPMK = 100  # and 20 effective lots: with 5 lots a 95 % interval covers 87 %
# Floor of the spread of squares: at its lower bound 0 a variance would be exact, which a few values cannot prove.
_LEAST_SPREAD = 0.2
_LEAST_FREEDOM = 2.0


@dataclass(frozen=True)
class TargetIndices:
    """Indices around a target."""

    tau: float  # root mean square around the target, in the unit of the response
    cpm_star: float
    cpm_star_interval: Interval | None  # None where it is withheld
    cpmk: float
    cpmk_interval: Interval | None  # None where it is withheld, and below 100 values


def target_indices(
    x: Array | Values,
    lsl: float | None,
    usl: float | None,
    target: float | None,
    confidence: float,
    lots: NDArray[np.generic] | None = None,
) -> TargetIndices | None:
    """Return the indices around a target; None without a target between the limits, or without spread around it.

    One limit is enough. Without `lots`, shape (n,), all finite values `x` are independent.
    """
    given = x if isinstance(x, Values) else Values(x)
    x = given.x
    if target is None or x.size < 2 or (lsl is None and usl is None):
        return None
    room = distance_to_limit(target, lsl, usl)
    with np.errstate(over="ignore", invalid="ignore"):  # squares of values near the largest double overflow
        mean, tau = float(np.mean(x)), _around(x, target)
    if room <= 0 or not ROUNDING * max(abs(target), magnitude(x)) < tau < math.inf:
        return None
    cpm_star, cpmk = room / (3 * tau), distance_to_limit(mean, lsl, usl) / (3 * tau)
    of_cpm, of_cpmk = None, None
    if given.location.get("std", 0.0) > 0:
        lots = None if lots is None or independent(lots) else lots
        described = None if lots is None else describe_lots(x, lots)
        method = choose_method(given, described)
        around = Fence(target - room, target + room, target, confidence)
        of_cpm = index_intervals(method, given, around, lots).get("cpm_interval")
        side = 1.0 if usl is None or (lsl is not None and mean - lsl < usl - mean) else -1.0

        def influence(piece: Array) -> Array:
            of_square = np.square((piece - target) / tau) - 1
            return np.asarray(side * (piece - mean) / (3 * tau) - cpmk * of_square / 2)

        def powers(piece: Array) -> tuple[Array, Array]:
            square = np.square(influence(piece))
            return square, np.square(square)

        enough = x.size >= FEWEST_FOR_CPMK and (described is None or round(described.worth) >= FEW_LOTS)
        if method.name and enough:
            error, freedom = mean_error(x, influence, lots)
            second, fourth = (each / x.size for each in sums(x, powers))
            spread = fourth / second**2 - 1
            known = min(max(2 * x.size / max(spread, _LEAST_SPREAD), _LEAST_FREEDOM), freedom)
            half = float(stdtrit(known, 0.5 + confidence / 2)) * error
            of_cpmk = (cpmk - half, cpmk + half)
    finite = [each if each is not None and _representable(each) else None for each in (of_cpm, of_cpmk)]
    return TargetIndices(tau, cpm_star, finite[0], cpmk, finite[1])
