"""Samples by status: their numbers, those that failed, and whether enough are ok for a verdict."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from reporting.format_numbers import grouped, short_percent
from reporting.samples import OK, Samples
from reporting.spec import ReportSpec

FAILURES_LISTED = 20
NOT_ASSEMBLABLE = "not_assemblable"

STATUSES = {
    OK: "ran to its end; its numbers are used",
    "not_at_rest": "still moving at its horizon; the message says what moves",
    "not_converged": "the solver failed: a step missed its tolerance, or no forces were found that balance the loads",
    "jammed": "a time step has no solution: a motion drives a body into one that cannot give way",
    "diverged": "a number became infinite or undefined",
    "timeout": "ran longer than its time limit",
    "invalid": "ran to its end, but broke a validity condition or missed an event",
    NOT_ASSEMBLABLE: "the parts overlap as drawn, and no start pose nearby is free; the message says why",
    "crashed": "the process ended or the code raised an error",
}


@dataclass(frozen=True)
class StatusCount:
    """Number of samples with a status, and the first of them as an example."""

    status: str
    meaning: str
    count: int
    share: float | None
    example: int | None
    message: str


@dataclass(frozen=True)
class FailedSample:
    """A failed sample, and the command that repeats it."""

    sample: int
    status: str
    message: str
    command: str


def count_statuses(samples: Samples) -> tuple[StatusCount, ...]:
    """Count the samples of every known status, even if there are none, and of every other status in the rows."""
    counts = []
    for status in [*STATUSES, *sorted(set(samples.statuses) - set(STATUSES))]:
        rows, meaning = samples.rows_of(status), STATUSES.get(status, "a status this version does not know")
        share = rows.size / samples.sample.size if samples.sample.size else None
        example = int(samples.sample[rows[0]]) if status != OK and rows.size > 0 else None
        message = "" if example is None else samples.messages.get(example, "")
        counts.append(StatusCount(status, meaning, int(rows.size), share, example, message))
    return tuple(counts)


def list_failures(spec: ReportSpec, samples: Samples) -> tuple[FailedSample, ...]:
    """List the first failed samples, each with the command that repeats it with the same inputs."""
    return tuple(
        FailedSample(
            sample=int(samples.sample[row]),
            status=samples.statuses[samples.status[row]],
            message=samples.messages.get(int(samples.sample[row]), ""),
            command=spec.command({v.name: samples.values[v.name][row] for v in spec.variables}),
        )
        for row in np.flatnonzero(~samples.ok)[:FAILURES_LISTED]
    )


def counts_by_status(samples: Samples) -> dict[str, int]:
    """Return the number of samples with each status that occurs."""
    return {status: int(samples.rows_of(status).size) for status in samples.statuses}


def judged_counts(counts: Mapping[str, int], limit: float | None) -> dict[str, int]:
    """Return the numbers of samples by status, without those that a limit of their own judges."""
    return {status: count for status, count in counts.items() if limit is None or status != NOT_ASSEMBLABLE}


def too_few_ok(ok: int, finished: int, least: float) -> bool:
    """Return whether fewer than the share `least` of the finished samples are ok; False without samples."""
    return finished > 0 and ok / finished < least


def failures_in_words(counts: Mapping[str, int]) -> str:
    """Return the failures, as in "12 of 20 samples failed (60 %: 10 not_converged, 2 timeout)"."""
    finished, failed = sum(counts.values()), sum(counts.values()) - counts.get(OK, 0)
    share = short_percent(failed / finished)
    return f"{grouped(failed)} of {grouped(finished)} samples failed ({share}: {statuses_in_words(counts)})"


def statuses_in_words(counts: Mapping[str, int]) -> str:
    """Return the statuses of failed samples, the most frequent first, such as "10 not_converged, 2 timeout"."""
    failed = sorted((-count, status) for status, count in counts.items() if status != OK and count)
    return ", ".join(f"{grouped(-count)} {status}" for count, status in failed)


def why_no_property(name: str, samples: Samples, least: float) -> str:
    """Return why a response has no verdict: more than 1 - `least` of its values are forces at impacts; else empty."""
    ok = int(np.count_nonzero(samples.ok))
    struck = int(np.count_nonzero(samples.at_impact[name] & samples.ok)) if name in samples.at_impact else 0
    if struck <= (1 - least) * ok:
        return ""
    return (
        f"{grouped(struck)} of {grouped(ok)} values are forces in the step of an impact: its impulse divided by the "
        "length of the step, and no property of the mechanism. Measure the impulse (contact_impulse) or a mean over a "
        "time (averaged_over), or drive so slowly that nothing strikes."
    )


def why_no_verdict(counts: Mapping[str, int], least: float) -> str:
    """Return why a campaign with less than the share `least` of ok samples has no verdict; empty if it may have one."""
    if not too_few_ok(counts.get(OK, 0), sum(counts.values()), least):
        return ""
    enough = short_percent(least)
    return f"{failures_in_words(counts)} and may be the rejects. A verdict needs at least {enough} ok samples."


def why_no_value(samples: Samples, values: int, least: float) -> str:
    """Return why a response has no verdict: too few samples have one, and the others may be rejects; else empty."""
    finished = samples.sample.size
    if not too_few_ok(values, finished, least):
        return ""
    missing = f"{grouped(finished - values)} of {grouped(finished)} samples have no value"
    return f"{missing} and may be the rejects. A verdict needs at least {short_percent(least)} with one."
