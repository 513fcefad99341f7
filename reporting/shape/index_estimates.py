"""Estimates of the methods without the normal distribution, on the scale of Cpk, for the verdict on a response.

Only reliable estimates are used: a fitted distribution with an interval, a Pareto tail that fits the values beyond its
threshold, and percentiles of enough values for an interval.
"""

import math
from collections.abc import Iterable
from dataclasses import replace

from reporting.capability.intervals import OpenInterval, with_ends
from reporting.capability.shares import least_ppm
from reporting.capability.verdict import IndexEstimate, index_of_share
from reporting.format_numbers import index, index_interval, ppm
from reporting.shape.fits import Fits
from reporting.shape.nonnormal import NonnormalIndices
from reporting.shape.tails import TailShare


def index_estimates(
    n: int, fits: Fits, methods: Iterable[NonnormalIndices], tails: Iterable[TailShare]
) -> tuple[IndexEstimate, ...]:
    """Return the estimates of `n` values from the fitted distribution, their own percentiles and the Pareto tails."""
    best, least, known = fits.of(fits.best), least_ppm(n), tuple(methods)
    title = best.title if best else ""
    ended = next((m.ppk_interval for m in known if m.method == "percentile" and m.family), None)
    estimates = [_by_method(method, title, least, ended) for method in known if method.method in _NAMES]
    return *(estimate for estimate in estimates if estimate is not None), *_by_tails(tuple(tails), least)


_NAMES = {"z_score": "fitted distribution", "empirical": "percentiles"}


def _by_method(method: NonnormalIndices, title: str, least: float, ended: OpenInterval | None) -> IndexEstimate | None:
    """Return the estimate of a method: its Ppk, or its share if that is too small for a Ppk; None without either.

    A distribution that ends before the limit has no share beyond it, however close its end is, and the end itself is
    fitted. Such a share therefore proves no more than `ended`, the interval of Ppk from the distribution's percentiles.
    """
    source = f"the fitted distribution ({title})" if method.family else "the values' own percentiles (Cnpk)"
    if method.family == "normal":
        source = "the distributions that the values allow"
    if method.ppk is not None and method.ppk_interval:
        low, high = with_ends(method.ppk_interval)
        words = f"Ppk {index(method.ppk)} ({index_interval(method.ppk_interval)}) by {source}"
        return IndexEstimate(_NAMES[method.method], low, method.ppk, high, words)
    if method.ppm_expected is not None and method.ppm_expected_interval:
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
