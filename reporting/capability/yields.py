"""The yield of a response: failures count as rejects."""

from dataclasses import dataclass

from scipy.special import ndtr, ndtri

from reporting.capability.intervals import share_lower_bound
from reporting.capability.shares import Nonconforming
from reporting.capability.summary import Capability


@dataclass(frozen=True)
class Yield:
    """The yield of a response over all finished samples, with failures counted as rejects."""

    finished: int  # samples
    conforming: int  # ok samples within the limits
    share: float  # conforming
    lower: float  # one-sided Clopper-Pearson bound of `share`
    # As if every failure lay beyond the nearer limit: ``-Phi^-1(f + (1 - f) Phi(-3 Cpk)) / 3`` with the failed share f.
    # Equal to Cpk without failures.
    cpk: float | None


def yield_with_failures(
    numbers: Capability, counted: Nonconforming | None, finished: int, confidence: float
) -> Yield | None:
    """Return the yield, with failures and missing values counted as rejects; None without limits or samples."""
    if finished == 0 or (numbers.lsl is None and numbers.usl is None):
        return None
    conforming = numbers.n - (numbers.below or 0) - (numbers.above or 0)
    failed = (finished - numbers.n) / finished
    effect = 1.0 if counted is None else finished / counted.with_failures.worth  # above 1 with production lots
    cpk = numbers.cpk
    if cpk is not None and failed > 0:
        cpk = -float(ndtri(failed + (1 - failed) * float(ndtr(-3 * cpk)))) / 3
    return Yield(
        finished=finished,
        conforming=conforming,
        share=conforming / finished,
        lower=share_lower_bound(conforming / effect, finished / effect, confidence),
        cpk=cpk,
    )
