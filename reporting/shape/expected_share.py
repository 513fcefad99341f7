"""The expected share out of limits of a response, by the normal distribution if the response is normal."""

from collections.abc import Iterable
from dataclasses import dataclass

from reporting.capability.intervals import Interval
from reporting.capability.summary import Capability
from reporting.shape.fits import Fits
from reporting.shape.nonnormal import NonnormalIndices
from reporting.shape.tails import TailShare


@dataclass(frozen=True)
class ExpectedShare:
    """Expected share of production out of limits."""

    ppm: float | None  # None if no estimate is reliable
    # of `ppm`; if `ppm` is None, the range over the distributions that the values do not distinguish
    interval: Interval | None
    # "normal", the title of a fitted distribution, "fitted distributions" for a range of several, "Pareto tail"; or
    # "not normal" if only the count is known.
    by: str


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
