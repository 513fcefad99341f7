"""The share of samples whose parts cannot be assembled, with its interval, and the limit that it has to keep.

Such a sample is no failed run but a result: its parts do not fit. Where the campaign sets a limit to their share, they
are judged by it, and everything else is about the samples that can be assembled; without a limit they count among the
failed samples, as what their responses would be is not known.
"""

from dataclasses import dataclass

import numpy as np

from reporting.capability.intervals import Interval, share_interval, share_lower_bound, share_upper_bound
from reporting.capability.lots import describe_lots, design_effect, independent
from reporting.format_numbers import grouped, short_percent
from reporting.samples import Samples
from reporting.spec import ReportSpec
from reporting.statuses import NOT_ASSEMBLABLE


@dataclass(frozen=True)
class AssemblyShare:
    """Share of the finished samples whose parts cannot be assembled, and how it compares with its limit."""

    count: int
    n: int  # finished samples
    share: float
    interval: Interval  # two-sided, by Clopper and Pearson; with production lots, of as many independent samples
    limit: float | None  # largest allowed share; None without one
    # "kept" or "exceeded" if the one-sided bound of the share is on that side of the limit, "open" if neither is; empty
    # without a limit
    verdict: str
    words: str  # all this in a sentence


def assembly_share(samples: Samples, spec: ReportSpec, confidence: float) -> AssemblyShare | None:
    """Return the share of samples that cannot be assembled; None if all can and no limit is set, or without samples.

    None also if the samples are not production, so that their number says nothing about a share.
    """
    n, rows, limit = samples.sample.size, samples.rows_of(NOT_ASSEMBLABLE), spec.max_not_assemblable
    if not n or not spec.design.production or (limit is None and not rows.size):
        return None
    stuck, effect = np.zeros(n, bool), 1.0
    stuck[rows] = True
    if samples.lots is not None and not independent(samples.lots):
        effect = design_effect(stuck, samples.lots, describe_lots(stuck.astype(float), samples.lots), confidence)
    count, worth = rows.size / effect, n / effect
    low, high = share_interval(count, worth, confidence)
    verdict = ""
    if limit is not None:
        kept = share_upper_bound(count, worth, confidence) <= limit
        verdict = "kept" if kept else "exceeded" if share_lower_bound(count, worth, confidence) > limit else "open"
    words = (
        f"{grouped(rows.size)} of {grouped(n)} samples cannot be assembled ({short_percent(rows.size / n)}, "
        f"{short_percent(low)} to {short_percent(high)})"
    )
    if limit is not None:
        ends = {"kept": "is kept", "exceeded": "is exceeded", "open": "may be exceeded: more samples would tell"}
        words += f"; the limit of {short_percent(limit)} {ends[verdict]}"
    return AssemblyShare(int(rows.size), n, rows.size / n, (low, high), limit, verdict, words)


def assembled(samples: Samples, spec: ReportSpec) -> Samples:
    """Return the samples that the rest of a report is about: without those that are judged by a limit of their own."""
    rows = samples.rows_of(NOT_ASSEMBLABLE)
    if spec.max_not_assemblable is None or not spec.design.production or not rows.size:
        return samples
    fit = np.ones(samples.sample.size, bool)
    fit[rows] = False
    return samples.where(fit)
