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

from reporting.capability.intervals import Interval, OpenInterval, with_ends
from reporting.capability.shares import least_ppm
from reporting.capability.summary import Capability
from reporting.capability.verdict import PERCENTILE, IndexEstimate, index_of_share
from reporting.format_numbers import index, index_interval, ppm
from reporting.shape.fitting import Fits
from reporting.shape.nonnormal import NonnormalIndices
from reporting.shape.tails import TailShare

_NAMES = {"z_score": "fitted distribution", "percentile": PERCENTILE}
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
) -> tuple[IndexEstimate, ...]:
    """Return the estimates of `n` values from the fitted distribution, its percentiles and the Pareto tails."""
    best, least, known = fits.of(fits.best), least_ppm(n), tuple(methods)
    title = best.title if best else ""
    ended = next((m.ppk_interval for m in known if m.method == "percentile" and m.family), None)
    estimates = [
        _by_method(method, title, least, ended) for method in known if method.method in _NAMES and method.family
    ]
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
        tuple(
            replace(
                method,
                pp_interval=None,
                ppk_interval=None,
                ppl_interval=None,
                ppu_interval=None,
                ppm_expected_interval=None,
                notes=(*method.notes, OF_LOTS),
            )
            for method in methods
        ),
        tuple(replace(tail, interval=None, note=f"{tail.note} {OF_LOTS}".strip()) for tail in tails),
    )


def _by_method(method: NonnormalIndices, title: str, least: float, ended: OpenInterval | None) -> IndexEstimate | None:
    """Return the estimate of a method: its Ppk, or its share if that is too small for a Ppk; None without either.

    A distribution that ends before the limit has no share beyond it, however close its end is, and the end itself is
    fitted. Such a share therefore proves no more than `ended`, the interval of Ppk from the distribution's percentiles.
    """
    source = "the distributions that the values allow"
    if method.family != "normal":
        of = "percentiles of the " if method.method == "percentile" else ""
        source = f"the {of}fitted distribution ({title})"
    if method.ppk is not None and method.ppk_interval:
        low, high = with_ends(method.ppk_interval)
        words = f"Ppk {index(method.ppk)} ({index_interval(method.ppk_interval)}) by {source}"
        return IndexEstimate(_NAMES[method.method], low, method.ppk, high, words)
    if method.method == "z_score" and method.ppm_expected is not None and method.ppm_expected_interval:
        low, high = method.ppm_expected_interval
        words = f"{ppm(method.ppm_expected, least)} ppm ({ppm(low, least)} to {ppm(high, least)}) by {source}"
        worst, value, best = (index_of_share(share) for share in (high, method.ppm_expected, low))
        if ended is not None and with_ends(ended)[0] < worst:
            worst = with_ends(ended)[0]
            words += f", Ppk {index_interval(ended)} by its percentiles,"
        return IndexEstimate(_NAMES[method.method], worst, value, best, words)
    return None


def _by_tails(tails: tuple[TailShare, ...], least: float) -> tuple[IndexEstimate, ...]:
    """Return the estimate of the Pareto tail of the worse side; empty without a fitted tail.

    A side whose tail is not fitted may be worse by any amount, so the estimate then has no lower end.
    """
    known = [tail for tail in tails if tail.interval]
    if not known:
        return ()
    sides = [_by_tail(tail, least) for tail in known]
    low = min(side.low for side in sides) if len(known) == len(tails) else -math.inf
    worst = min(sides, key=lambda side: (side.value, side.low))
    return (replace(worst, low=low, high=min(side.high for side in sides)),)


def _by_tail(tail: TailShare, least: float) -> IndexEstimate:
    """Return the estimate of a Pareto tail: the share beyond one limit, or a bound on it."""
    assert tail.interval is not None
    low, high = tail.interval
    share = f"at most {ppm(high, least)} ppm"
    if tail.ppm is not None:
        share = f"{ppm(tail.ppm, least)} ppm ({ppm(low, least)} to {ppm(high, least)})"
    words = f"{share} {tail.side} the limit by a Pareto tail"
    value = math.inf if tail.ppm is None else index_of_share(tail.ppm)
    return IndexEstimate("tail", index_of_share(high), value, index_of_share(low), words)
