"""Compute rows in an isolated subprocess, for a batch that killed its worker; the run at fault becomes a row.

A run is to blame for the end of its child process only if it had begun and was the child's first run; otherwise a
remnant of an earlier run, such as a thread or full memory, may be the cause. A child that ends before a run, between
two runs, or with an error of its own has failed by itself, and another is started. If the cause may be external, such
as a signal that others send too, a run is guilty only if several children in a row end in it, with increasing pauses.
A child that hangs, for example because somebody stopped it, is killed, and counts as killed by others.
"""

import logging
import os
import pickle
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.safe_path import python_environment
from campaign.worker.isolated_child import COMMAND
from campaign.worker.messages import CampaignAddress, ChildFailed
from campaign.worker.row import Row, crashed_row, longest_sample, read_campaign, sample_values

logger = logging.getLogger(__name__)

READY_WITHIN = 900.0  # s for a child to start, compile the engine and open the store, beyond the store's retries
BUSY = 60.0  # s that a run may take beyond its limit on an overloaded machine
# Signals that operators and the operating system send too, so that they do not prove the run guilty.
AMBIGUOUS = {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
TRIES = 5  # processes in a row that a run must end to be guilty, if there may be another cause
TIMEOUTS = 2  # processes whose time limit a run must exceed to be guilty; a paused process exceeds it too
STARTS = 10  # attempts to start a process that fails by itself
PAUSES = (0.5, 8.0)  # s; the first and the longest pause between two processes; each is twice the one before
LOOK_INTERVAL = 2.0  # s between two checks of a child


@dataclass(frozen=True)
class _Ending:
    """How a child ended."""

    rows: int  # number of rows that it sent
    kind: str  # of its last message, see `campaign.worker.isolated_child`; empty if it sent none
    content: Any
    exit_status: int  # as in `subprocess.Popen.wait`
    hung: bool = False  # whether it was killed because it hung

    @property
    def in_run(self) -> bool:
        """Whether a run had begun but not ended."""
        return self.kind in ("begun", "doubtful")

    @property
    def tries(self) -> int:
        """Number of children that must end this way, each in its first run, for the run to be guilty."""
        if self.kind == "doubtful" or -self.exit_status in AMBIGUOUS:
            return TRIES
        return TIMEOUTS if self.exit_status == -signal.SIGALRM else 1

    def text(self) -> str:
        """Return the ending in words."""
        if -self.exit_status in set(signal.Signals):
            return signal.Signals(-self.exit_status).name
        return f"signal {-self.exit_status}" if self.exit_status < 0 else f"exit status {self.exit_status}"


def rows_in_subprocess(address: CampaignAddress, samples: Sequence[int], attempt: int) -> Iterator[Row]:
    """Yield the row of each sample, in order, computed in a child process; replace a child that ends too early.

    Runs that ended their process have rows too. ``attempt`` is that of the batch, from 1. Raises Cancelled if the
    campaign is cancelled meanwhile, ChildFailed if `STARTS` children in a row fail for reasons of their own, and what
    `campaign.worker.row.read_campaign` raises.
    """
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
    rows, kind, content = 0, "", None
    try:
        child = _start_child()
    except OSError as error:
        return _Ending(0, "failed", error, 0)
    with child, Watchdog(child, ready_within) as watch:
        for kind, content in _messages(child, (address, samples, attempt)):
            watch.heard(longest + BUSY if kind == "begun" else ready_within)
            if kind == "row":
                yield content
                rows += 1
        child.wait()
    return _Ending(rows, kind, content, child.returncode, watch.hung)


def _start_child() -> "subprocess.Popen[bytes]":
    """Start a child that Ctrl-C does not reach and that imports like this process, but not from the current folder."""
    return subprocess.Popen(
        COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=python_environment(), start_new_session=True
    )


def _messages(child: "subprocess.Popen[bytes]", request: object) -> Iterator[tuple[str, Any]]:
    """Send a request to a child and yield its messages until it ends; drop an incomplete message."""
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        pickle.dump(request, child.stdin)
        child.stdin.flush()
    except BrokenPipeError:
        return
    while True:
        try:
            message = pickle.load(child.stdout)
            kind, content = message
        except EOFError:
            return
        except Exception:  # unpickling arbitrary bytes can raise anything
            child.kill()
            return
        yield kind, content


def _raise_failure(ending: _Ending, failures: int) -> None:
    """Raise the error of a child that failed, if another child would fail too or enough children have failed."""
    error = ending.content if ending.kind == "failed" else None
    if isinstance(error, CampaignError) and not isinstance(error, ChildFailed):
        raise error
    reason = f"it ended with {ending.text()}" if error is None else f"{type(error).__name__}: {error}"
    if failures >= STARTS:
        raise ChildFailed(
            f"the process that computes runs in isolation failed {failures} times in a row, never in a run ({reason});"
            " look at the worker's log and at the memory of its machine, then run the same command again"
        ) from error
    logger.warning(
        "the process that computes runs in isolation failed, and not in a run (%s); starting another", reason
    )


def _guilty_row(plan: Plan, sample: int, ending: _Ending) -> Row:
    """Return the row of a run that ended its process."""
    if ending.kind == "doubtful":
        return dict(ending.content)
    status = "timeout" if ending.exit_status == -signal.SIGALRM else "crashed"
    message = f"the run {_deed(ending)}; repeat it with clearcap replay to see why"
    return crashed_row(plan, sample, sample_values(plan, sample), message, status=status)


def _deed(ending: _Ending) -> str:
    """Describe how a run ended its process."""
    if ending.exit_status == -signal.SIGALRM:
        return "took no notice of its time limit and was ended"
    if ending.hung:
        return f"took no notice of its time limit {TRIES} times in a row; perhaps someone stopped its process each time"
    if -ending.exit_status in AMBIGUOUS:
        return (
            f"ended with its process, killed by {ending.text()} {TRIES} times in a row; perhaps it needs more memory"
            " than the machine has, perhaps the signal came from outside"
        )
    return f"{'killed' if ending.exit_status < 0 else 'ended'} its process ({ending.text()})"


def _pause(failures: int) -> None:
    """Wait; each failure doubles the pause, up to a limit."""
    first, longest = PAUSES
    time.sleep(min(first * 2.0 ** (failures - 1), longest))


class Watchdog:
    """A context in which a thread kills a child that sends nothing for too long, checking every two seconds.

    Only time while this process is awake counts: a check adds at most twice the interval between checks, so that the
    child is not blamed if a laptop sleeps or all processes of a campaign are stopped.

    The child leads a session of its own, and the processes that it started are killed with it. It may be silent for
    ``allowed`` seconds at first. `hung` says whether it was killed for its silence.
    """

    def __init__(
        self, child: "subprocess.Popen[bytes]", allowed: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.hung = False
        self._child, self._clock = child, clock
        self._last = self._seen = (0, allowed)  # number of messages; how long the child may be silent now
        self._silent_for = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="silent child", daemon=True)

    def __enter__(self) -> "Watchdog":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def heard(self, allowed: float) -> None:
        """Record that the child has sent a message, after which it may be silent for ``allowed`` seconds."""
        self._last = (self._last[0] + 1, allowed)

    def is_silent(self, passed: float) -> bool:
        """Return whether the child has been silent for too long, ``passed`` seconds after the last check."""
        if self._last != self._seen:
            self._seen, self._silent_for = self._last, 0.0
        else:
            self._silent_for += min(passed, 2.0 * LOOK_INTERVAL)
        return self._silent_for > self._seen[1]

    def _watch(self) -> None:
        looked_at = self._clock()
        while not self._over.wait(LOOK_INTERVAL):
            now = self._clock()
            if self.is_silent(now - looked_at):
                self._end()
                return
            looked_at = now

    def _end(self) -> None:
        self.hung = True
        logger.warning(
            "the process that computes runs in isolation sends nothing for %.0f s: it hangs or was stopped, is killed,"
            " and its run is tried again",
            self._silent_for,
        )
        with suppress(ProcessLookupError):  # it ended at this moment
            os.killpg(self._child.pid, signal.SIGKILL)
