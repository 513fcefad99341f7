"""Whether enough samples are ok for a verdict, and the statuses of the others in words."""

from collections.abc import Mapping

from reporting.format_numbers import grouped, short_percent
from reporting.samples import OK, Samples


def counts_by_status(samples: Samples) -> dict[str, int]:
    """Return the number of samples with each status that occurs."""
    return {status: int(samples.rows_of(status).size) for status in samples.statuses}


def too_few_ok(ok: int, finished: int, least: float) -> bool:
    """Return whether fewer than the share `least` of the finished samples are ok; False without samples."""
    return finished > 0 and ok / finished < least


def failures_in_words(counts: Mapping[str, int]) -> str:
    """Return the number of failed samples in words: "12 of 20 samples failed (60 %: 10 not_converged, 2 timeout)".

    `counts` has the number of samples by status; the most frequent one comes first.
    """
    finished, failed = sum(counts.values()), sum(counts.values()) - counts.get(OK, 0)
    share = short_percent(failed / finished)
    return f"{grouped(failed)} of {grouped(finished)} samples failed ({share}: {statuses_in_words(counts)})"


def statuses_in_words(counts: Mapping[str, int]) -> str:
    """Return the statuses of failed samples, the most frequent first, such as "10 not_converged, 2 timeout"."""
    failed = sorted((-count, status) for status, count in counts.items() if status != OK and count)
    return ", ".join(f"{grouped(-count)} {status}" for count, status in failed)


def why_no_verdict(counts: Mapping[str, int], least: float) -> str:
    """Return why a campaign with less than the share `least` of ok samples has no verdict; empty if it may have one."""
    if not too_few_ok(counts.get(OK, 0), sum(counts.values()), least):
        return ""
    enough = short_percent(least)
    return f"{failures_in_words(counts)} and may be the rejects. A verdict needs at least {enough} ok samples."
