"""Compute a batch on a worker and write its part to the store; only counts travel back to the coordinator.

Every run becomes a row, however it ends. If a run kills its process, the batch is lost; the coordinator then requests
the batch again with its runs in an isolated subprocess, where the run at fault becomes a row too. If the machine may
have caused the error of a run, the run is repeated in such a subprocess at once.
"""

import logging
import pickle
import signal
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from time import perf_counter

from campaign import errors
from campaign.errors import error_named
from campaign.plan import Plan
from campaign.store import BadPart
from campaign.worker import messages
from campaign.worker.messages import BatchRequest, BatchResult, CampaignAddress, ChildFailed, DoubtfulRun, moments
from campaign.worker.row import (
    Row,
    crashed_row,
    longest_sample,
    open_campaign,
    open_repeats,
    read_campaign,
    repeats_to_table,
    rows_in_process,
    rows_to_table,
    sample_values,
)
from engine.platform.child import Child, ChildEnded, ChildRaised, Limits, Send

READY_WITHIN = 900.0  # s for a child to start, compile the engine and open the store, beyond the store's retries
BUSY = 60.0  # s that a run may take beyond its limit on an overloaded machine
# Signals that operators and the operating system send too, so that they do not prove the run guilty.
AMBIGUOUS = {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
TRIES = 5  # processes in a row that a run must end to be guilty, if there may be another cause
TIMEOUTS = 2  # processes whose time limit a run must exceed to be guilty; a paused process exceeds it too
STARTS = 10  # attempts to start a process that fails by itself
PAUSES = (0.5, 8.0)  # s; the first and the longest pause between two processes; each is twice the one before
BEGUN, ROW, DOUBTFUL = "begun", "row", "doubtful"  # messages of a child; see `compute`
logger = logging.getLogger(__name__)


def run_batches(address: CampaignAddress, requests: Sequence[BatchRequest]) -> list[BatchResult]:
    """Compute batches one after the other; parts written before an error stay. Raises what `run_batch` raises."""
    return [run_batch(address, request) for request in requests]


def run_batch(address: CampaignAddress, request: BatchRequest) -> BatchResult:
    """Compute a batch and the repeats of its samples, and write their parts, unless the store has them already."""
    store, plan = open_campaign(address)
    start = perf_counter()
    if request.has_rows:
        repeats = _repeats(address, request)
        return BatchResult(None, {}, computed=False, seconds=perf_counter() - start, repeats=repeats)
    try:
        # there if an earlier attempt wrote it, but its answer was lost with the worker or the scheduler
        (part, table), computed = store.read_own_part(plan, request.batch), False
    except (FileNotFoundError, BadPart):
        first, count = plan.batches[request.batch]
        rows = _rows(address, range(first, first + count), request)
        table, computed = rows_to_table(plan, rows), True
        part = store.write_part(plan, request.batch, table)
    repeats = _repeats(address, request)
    return BatchResult(part, moments(table, plan.mechanism.responses), computed, perf_counter() - start, repeats)


def _repeats(address: CampaignAddress, request: BatchRequest) -> int:
    """Compute the repeats of a batch's samples that the store lacks; return the number of repeats of the batch."""
    (store, plan), number = open_campaign(address), 0
    for repeats in open_repeats(address):
        batch = repeats.batch_of(request.batch)
        if batch is None:
            continue
        first, count = repeats.batches[batch]
        number += count
        try:
            store.read_part(repeats, batch)
        except (FileNotFoundError, BadPart):
            rows = _rows(replace(address, halved=True), repeats.numbers_of(first, first + count), request)
            store.write_part(repeats, batch, repeats_to_table(plan, repeats, rows))
    return number


def _rows(address: CampaignAddress, samples: Sequence[int], request: BatchRequest) -> list[Row]:
    """Return the rows of a batch, computed in this process unless isolation is requested or a run is doubtful."""
    if not request.isolated:
        with suppress(DoubtfulRun):
            return list(rows_in_process(address, samples, request.attempt))
    return list(rows_in_subprocess(address, samples, request.attempt))


# -- isolated runs -----------------------------------------------------------------------------------------------------
#
# A run is to blame for the end of its child process only if it had begun and was the child's first run; otherwise a
# remnant of an earlier run, such as a thread or full memory, may be the cause. A child that ends before a run, between
# two runs, or with an error of its own has failed by itself, and another is started. If the cause may be external, such
# as a signal that others send too, a run is guilty only if several children in a row end in it, with increasing pauses.
# A child that hangs, for example because somebody stopped it, is killed, and counts as killed by others.


def compute(request: bytes, send: Send) -> None:
    """Compute rows in a child, which says when a run begins, and sends its row; a doubtful run is the last one."""
    address, samples, attempt = pickle.loads(request)
    try:
        for row in rows_in_process(address, samples, attempt, lambda _: send(BEGUN, b"")):
            send(ROW, pickle.dumps(row))
    except DoubtfulRun as error:
        send(DOUBTFUL, pickle.dumps(error.row))


@dataclass(frozen=True)
class _Ending:
    """How a child ended."""

    rows: int  # number of rows that it sent
    kind: str = ""  # of its last message; empty if it sent none
    doubtful: Row | None = None  # the row of a doubtful run
    error: Exception | None = None  # why it could not go on, or not start; None if a run had begun but not ended

    @property
    def in_run(self) -> bool:
        """Whether a run had begun but not ended."""
        return self.doubtful is not None or (self.kind == BEGUN and isinstance(self.error, ChildEnded))

    @property
    def exit_status(self) -> int:
        """As of `subprocess.Popen.wait`; 0 if it did not end by itself."""
        return self.error.status if isinstance(self.error, ChildEnded) else 0

    @property
    def was_silent(self) -> bool:
        """Whether it was killed because it sent nothing for too long."""
        return isinstance(self.error, ChildEnded) and self.error.was_silent

    @property
    def tries(self) -> int:
        """Number of children that must end this way, each in its first run, for the run to be guilty."""
        if self.doubtful is not None or -self.exit_status in AMBIGUOUS:
            return TRIES
        return TIMEOUTS if self.exit_status == -signal.SIGALRM else 1


def rows_in_subprocess(address: CampaignAddress, samples: Sequence[int], attempt: int) -> Iterator[Row]:
    """Yield the row of each sample, in order, computed in a child process; replace a child that ends too early."""
    # Runs that ended their process have rows too. Raises Cancelled, and ChildFailed if `STARTS` children in a row fail
    # for reasons of their own.
    _, plan = read_campaign(address)
    deaths = alone = failures = 0  # children that ended in the next run; in their first run; for reasons of their own
    while samples:
        # only the first run of a child can be guilty, so after a death the next run gets a child of its own
        requested = samples[:1] if deaths else samples
        ending = yield from _rows_of_child(address, requested, attempt + deaths, longest_sample(plan))
        samples = samples[ending.rows :]
        if ending.rows:
            deaths = alone = failures = 0
        if ending.rows == len(requested):
            continue
        if not ending.in_run:
            failures += 1
            _raise_failure(ending, failures)
            _pause(failures)
            continue
        deaths, alone, failures = deaths + 1, alone + (ending.rows == 0), 0
        if alone < ending.tries:
            _pause(deaths)
            continue
        yield _guilty_row(plan, samples[0], ending) | {"attempts": attempt + deaths - 1}
        samples, deaths, alone = samples[1:], 0, 0


def _rows_of_child(
    address: CampaignAddress, samples: Sequence[int], attempt: int, longest: float
) -> Generator[Row, None, _Ending]:
    """Yield the rows of one child, each of which may take ``longest`` seconds; return how the child ended."""
    ready_within = READY_WITHIN + address.retry_policy.seconds
    rows, kind, doubtful = 0, "", None
    try:
        with Child(f"{__name__}:{compute.__name__}") as child:
            request = pickle.dumps((address, samples, attempt))
            allowed = lambda kind: longest + BUSY if kind == BEGUN else ready_within  # noqa: E731
            for kind, content in child.messages(request, Limits(), allowed):
                if kind == ROW:
                    yield pickle.loads(content)
                    rows += 1
                elif kind == DOUBTFUL:
                    doubtful = pickle.loads(content)
    except (OSError, ChildRaised, ChildEnded) as error:
        ending = _Ending(rows, kind, doubtful, error)
        if ending.was_silent:
            logger.warning(
                "the process that computes runs in isolation sent nothing for too long: it hangs or was stopped, was"
                " killed, and its run is tried again"
            )
        return ending
    return _Ending(rows, kind, doubtful)


def _raise_failure(ending: _Ending, failures: int) -> None:
    """Raise the error of a child that failed, if another child would fail too or enough children have failed."""
    error = ending.error
    if isinstance(error, ChildRaised):
        kind = error_named(error.kinds, errors, messages)
        if kind not in (None, ChildFailed):
            raise kind(error.message) from error
    reason = f"{type(error).__name__}: {error}" if isinstance(error, OSError) else str(error)
    if failures >= STARTS:
        raise ChildFailed(
            f"the process that computes runs in isolation failed {failures} times in a row, never in a run ({reason});"
            " look at the worker's log and at the memory of its machine, then run the same command again"
        ) from error
    logger.warning(
        "the process that computes runs in isolation failed, and not in a run (%s); starting another", reason
    )


def _guilty_row(plan: Plan, sample: int, ending: _Ending) -> Row:
    if ending.doubtful is not None:
        return ending.doubtful
    status = "timeout" if ending.exit_status == -signal.SIGALRM else "crashed"
    message = f"the run {_deed(ending)}; repeat it with clearcap replay to see why"
    return crashed_row(plan, sample, sample_values(plan, sample), message, status=status)


def _deed(ending: _Ending) -> str:
    if ending.exit_status == -signal.SIGALRM:
        return "ignored its time limit and was ended"
    if ending.was_silent:
        return f"ignored its time limit {TRIES} times in a row; perhaps someone stopped its process each time"
    if -ending.exit_status in AMBIGUOUS:
        return (
            f"ended with its process, killed by {ending.error} {TRIES} times in a row; perhaps it needs more memory"
            " than the machine has, perhaps the signal came from outside"
        )
    return f"{'killed' if ending.exit_status < 0 else 'ended'} its process ({ending.error})"


def _pause(failures: int) -> None:
    """Wait; each failure doubles the pause, up to a limit."""
    first, longest = PAUSES
    time.sleep(min(first * 2.0 ** (failures - 1), longest))
