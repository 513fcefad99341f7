"""Results of the methods without the normal distribution for one response, from its fits, percentiles and tails.

Their estimates on the scale of Cpk are for the verdict; only reliable ones are used: a fitted distribution with an
interval, and a Pareto tail that fits the values beyond its threshold. The expected share out of limits is that of the
normal distribution if the response is normal, else one of theirs.

Their intervals assume independent values, so they are suppressed if the values are in production lots. Intervals of
mean, sigma, their indices and counted shares allow for lots.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import ndtr

from reporting.arrays import Array, standard_deviation
from reporting.capability.intervals import Estimate, Interval, OpenInterval, with_ends
from reporting.capability.shares import PPM, least_ppm
from reporting.capability.summary import Capability
from reporting.capability.verdict import PERCENTILE, SecondPopulation, index_of_share
from reporting.format_numbers import grouped, index, index_interval, part, ppm
from reporting.shape.fitting import Fits
from reporting.shape.nonnormal import NonnormalIndices
from reporting.shape.pareto import TailShare

_NAMES = {"z_score": "fitted distribution", "percentile": PERCENTILE}
_NO_INTERVALS: dict[str, Any] = dict.fromkeys(
    ("pp_interval", "ppk_interval", "ppl_interval", "ppu_interval", "ppm_expected_interval")
)
OF_LOTS = "No interval: it would treat the values of a production lot as independent."


@dataclass(frozen=True)
class ExpectedShare:
    """Expected share of production out of limits."""

    ppm: float | None  # None if no estimate is reliable
    # of `ppm`; if `ppm` is None, the range over the distributions that the values do not distinguish
    interval: Interval | None
    # "normal", the title of a fitted distribution, "fitted distributions" for a range of several, "Pareto tail"; or
    # "not normal" if only the count is known.
    by: str


def index_estimates(
    n: int, fits: Fits, methods: Iterable[NonnormalIndices], tails: Iterable[TailShare]
) -> tuple[Estimate, ...]:
    """Return the estimates of `n` values from the fitted distribution, its percentiles and the Pareto tails."""
    best, least = fits.of(fits.best), least_ppm(n)
    fitted = [method for method in methods if method.method in _NAMES and method.family]
    ended = next((method.ppk_interval for method in fitted if method.method == "percentile"), None)
    estimates = [_by_method(method, best.title if best else "", least, ended) for method in fitted]
    return *(estimate for estimate in estimates if estimate is not None), *_by_tails(tuple(tails), least)


def expected_share(
    numbers: Capability, fits: Fits, methods: Iterable[NonnormalIndices], tails: Iterable[TailShare], *, normal: bool
) -> ExpectedShare | None:
    """Return the expected share out of limits, None without an index; `normal` is False if it is proven otherwise."""
    if numbers.ppm_expected is None:
        return None
    if normal:
        return ExpectedShare(numbers.ppm_expected, numbers.ppm_expected_interval, "normal")
    best = fits.of(fits.best)
    for method in methods:
        if method.method != "z_score" or method.family in (None, "normal"):
            continue
        if method.ppm_range is not None:
            return ExpectedShare(None, method.ppm_range, "fitted distributions")
        if method.ppm_expected is not None:
            return ExpectedShare(method.ppm_expected, method.ppm_expected_interval, best.title if best else "fitted")
    known = list(tails)
    if known and all(tail.ppm is not None for tail in known):
        ends = [tail.interval for tail in known if tail.interval is not None]
        interval = (sum(low for low, _ in ends), sum(high for _, high in ends)) if len(ends) == len(known) else None
        return ExpectedShare(sum(tail.ppm or 0.0 for tail in known), interval, "Pareto tail")
    return ExpectedShare(None, None, "not normal")


def without_intervals(
    methods: Iterable[NonnormalIndices], tails: Iterable[TailShare]
) -> tuple[tuple[NonnormalIndices, ...], tuple[TailShare, ...]]:
    """Return methods and tails for values in lots: the estimates without their intervals, with a note on why."""
    return (
        tuple(replace(method, **_NO_INTERVALS, notes=(*method.notes, OF_LOTS)) for method in methods),
        tuple(replace(tail, interval=None, note=f"{tail.note} {OF_LOTS}".strip()) for tail in tails),
    )


def _by_method(method: NonnormalIndices, title: str, least: float, ended: OpenInterval | None) -> Estimate | None:
    """Return the estimate of a method: its Ppk, or its share if that is too small for a Ppk; None without either.

    A distribution that ends before the limit has no share beyond it, and the end itself is fitted. Such a share proves
    no more than `ended`, the interval of Ppk from the distribution's percentiles.
    """
    source = "the distributions that the values allow"
    if method.family != "normal":
        of = "percentiles of the " if method.method == "percentile" else ""
        source = f"the {of}fitted distribution ({title})"
    if method.ppk is not None and method.ppk_interval:
        low, high = with_ends(method.ppk_interval)
        words = f"Ppk {index(method.ppk)} ({index_interval(method.ppk_interval)}) by {source}"
        return Estimate(method.ppk, (low, high), _NAMES[method.method], words)
    if method.method == "z_score" and method.ppm_expected is not None and method.ppm_expected_interval:
        low, high = method.ppm_expected_interval
        words = f"{ppm(method.ppm_expected, least)} ppm ({ppm(low, least)} to {ppm(high, least)}) by {source}"
        worst, value, best = (index_of_share(share) for share in (high, method.ppm_expected, low))
        if ended is not None and with_ends(ended)[0] < worst:
            worst = with_ends(ended)[0]
            words += f", Ppk {index_interval(ended)} by its percentiles,"
        return Estimate(value, (worst, best), _NAMES[method.method], words)
    return None


def _by_tails(tails: tuple[TailShare, ...], least: float) -> tuple[Estimate, ...]:
    """Return the estimate of the Pareto tail of the worse side, without a lower end if a side's tail is not fitted."""
    known = [tail for tail in tails if tail.interval]
    if not known:
        return ()
    sides = [_by_tail(tail, least) for tail in known]
    low = min(side.low for side in sides) if len(known) == len(tails) else -math.inf
    worst = min(sides, key=lambda side: (side.value, side.low))
    return (replace(worst, interval=(low, min(side.high for side in sides))),)


def _by_tail(tail: TailShare, least: float) -> Estimate:
    """Return the estimate of a Pareto tail: the share beyond one limit, or a bound on it."""
    assert tail.interval is not None
    low, high = tail.interval
    share = f"at most {ppm(high, least)} ppm"
    if tail.ppm is not None:
        share = f"{ppm(tail.ppm, least)} ppm ({ppm(low, least)} to {ppm(high, least)})"
    words = f"{share} {tail.side} the limit by a Pareto tail"
    value = math.inf if tail.ppm is None else index_of_share(tail.ppm)
    return Estimate(value, (index_of_share(high), index_of_share(low)), "tail", words)


# What the values cannot show: a small second population, wider than the rest or shifted, with a share out of limits.
#
# A mechanism may behave in another way in a few of a thousand assemblies: another contact, a stop that is reached. If a
# share e of production comes from a population of which a part p lies outside the range of the n values, the values
# have none of these with the probability (1 - e p)^n. Shares for which that is below 5 % are excluded; the largest
# share that is not, at most `MOST`, is assumed where a verdict claims to be certain. A second population of less than
# `LEAST` is never assumed: plain samples cannot exclude it at a reasonable cost, and the page says so. Weighted runs
# can.

LEAST, MOST = 0.002, 0.05  # shares of production
_MISSED = 0.05  # probability of values without any of the second population
# Centre and sigma of the second population, in sigmas of the values.
_WIDER = ((0.0, 3.0), (0.0, 5.0))
_SHIFTED = tuple((sign * shift, 1.0) for sign in (-1.0, 1.0) for shift in (4.0, 6.0, 8.0))
ASSUMES = (
    f"Certain provided that less than {part(LEAST)} of production is a second population, up to five times as wide "
    "or shifted by up to 8σ; these samples do not exclude a smaller one."
)


def second_population(x: Array, lsl: float | None, usl: float | None, worth: float) -> SecondPopulation | None:
    """Return the worst second population that values worth so many permit, of 0 ppm if none; None if they are equal."""
    mean, std = float(np.mean(x)), standard_deviation(x)
    if not std > 0 or not math.isfinite(std):
        return None
    low, high = (float(end) for end in ((x.min() - mean) / std, (x.max() - mean) / std))
    found = SecondPopulation(0.0, "", ASSUMES)
    for centre, sigma in (*_WIDER, *_SHIFTED):
        outside = float(ndtr((low - centre) / sigma) + ndtr((centre - high) / sigma))
        possible = min(-math.log(_MISSED) / (worth * outside), MOST) if outside > 0 else MOST
        if possible < LEAST:
            continue
        beyond = max(
            0.0 if lsl is None else float(ndtr(((lsl - mean) / std - centre) / sigma)),
            0.0 if usl is None else float(ndtr((centre - (usl - mean) / std) / sigma)),
        )
        if PPM * possible * beyond > found.ppm:
            kind = f"{sigma:g} times as wide" if centre == 0 else f"shifted by {abs(centre):g}σ"
            words = (
                f"{grouped(x.size)} values do not rule out that {part(possible)} of production is a second population "
                f"{kind}, with {ppm(PPM * possible * beyond)} ppm beyond a limit"
            )
            found = SecondPopulation(PPM * possible * beyond, words, ASSUMES)
    return found
