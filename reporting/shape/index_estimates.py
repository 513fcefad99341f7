"""What the methods without the normal distribution say of a response, in the scale of Cpk, for its verdict.

Only what is worth believing takes part: a fitted distribution with an interval, a Pareto tail that fits the values
beyond its threshold, and percentiles of values enough for an interval.
"""

import math
from collections.abc import Iterable

from reporting.capability.shares import least_ppm
from reporting.capability.verdict import IndexEstimate, index_of_share
from reporting.format_numbers import index, ppm
from reporting.shape.fits import Fits
from reporting.shape.nonnormal import NonnormalIndices
from reporting.shape.tails import TailShare


def index_estimates(
    n: int, fits: Fits, methods: Iterable[NonnormalIndices], tails: Iterable[TailShare]
) -> tuple[IndexEstimate, ...]:
    """Return the estimates of the fitted distribution, the values' own percentiles and the Pareto tails.

    Parameters
    ----------
    n : int
        Number of values.
    fits : Fits
        Fitted distributions.
    methods : iterable of NonnormalIndices
        Of the chosen distribution and of the values' own percentiles.
    tails : iterable of TailShare
    """
    best = fits.of(fits.best)
    estimates = [
        IndexEstimate(_NAMES[method.method], *_ends(method), _words(method, best.title if best else ""))
        for method in methods
        if method.method in _NAMES and method.ppk is not None and method.ppk_interval and method.family != "normal"
    ]
    return *estimates, *(_by_tail(tail, least_ppm(n)) for tail in tails if tail.ppm is not None and tail.interval)


_NAMES = {"z_score": "fitted distribution", "empirical": "percentiles"}


def _ends(method: NonnormalIndices) -> tuple[float, float, float]:
    """Return low end, value and high end of a method's Ppk."""
    assert method.ppk is not None
    low, high = method.ppk_interval or (-math.inf, math.inf)
    return low, method.ppk, high


def _words(method: NonnormalIndices, title: str) -> str:
    """Return the estimate of a method in words."""
    low, value, high = _ends(method)
    source = f"the fitted distribution ({title})" if method.family else "the values' own percentiles (Cnpk)"
    return f"Ppk {index(value)} ({index(low)} to {index(high)}) by {source}"


def _by_tail(tail: TailShare, least: float) -> IndexEstimate:
    """Return the estimate of a Pareto tail: the share beyond one limit."""
    assert tail.ppm is not None
    assert tail.interval is not None
    low, high = tail.interval
    words = (
        f"{ppm(tail.ppm, least)} ppm ({ppm(low, least)} to {ppm(high, least)}) {tail.side} the limit by a Pareto tail"
    )
    return IndexEstimate("tail", index_of_share(high), index_of_share(tail.ppm), index_of_share(low), words)
