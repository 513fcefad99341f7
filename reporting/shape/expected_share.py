"""The expected share out of limits that stands for a response: that of a normal distribution, where it is one."""

from collections.abc import Iterable
from dataclasses import dataclass

from reporting.capability.intervals import Interval
from reporting.capability.summary import Capability
from reporting.shape.fits import Fits
from reporting.shape.nonnormal import NonnormalIndices
from reporting.shape.tails import TailShare


@dataclass(frozen=True)
class ExpectedShare:
    """What share of production to expect out of limits.

    Attributes
    ----------
    ppm : float or None
        In parts per million; None where no estimate is worth a number.
    interval : (float, float) or None
        Of `ppm`; without it, the range of distributions that the values do not tell from each other.
    by : str
        What it rests on: "normal", the title of a fitted distribution, "fitted distributions" for a range of several,
        "Pareto tail"; or "not normal" where nothing is known but the count.
    """

    ppm: float | None
    interval: Interval | None
    by: str


def expected_share(
    numbers: Capability, fits: Fits, methods: Iterable[NonnormalIndices], tails: Iterable[TailShare], *, normal: bool
) -> ExpectedShare | None:
    """Return the expected share out of limits of a response; None where it has no index.

    Parameters
    ----------
    numbers : Capability
        Its indices.
    fits, methods, tails
        Its estimates without the normal distribution.
    normal : bool
        The values are not proven to be other than normal.
    """
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
