"""Compute rows in an isolated subprocess, for a batch that killed its worker: the run at fault becomes a row.

Only a run that had begun can be to blame for the end of its child process, and only if it was the child's first run:
what an earlier one left behind, a thread or a full memory, may have ended it. A child that ends before a run, between
two runs, or with an error of its own has failed itself; it is started again. Where the cause may lie outside, such as a
signal that others send too, a run is guilty when child after child ends in it, with ever longer pauses. A child that
hangs, because someone stopped it, is killed, and counts as one that others have killed.
"""

import logging
import pickle
import signal
import subprocess
import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.safe_path import python_environment
from campaign.worker.isolated_child import COMMAND
from campaign.worker.messages import CampaignAddress, ChildFailed
from campaign.worker.row import Row, crashed_row, longest_sample, sample_values
from campaign.worker.runs import read_campaign
from campaign.worker.silent_child import ChildWatch

logger = logging.getLogger(__name__)

READY_WITHIN = 900.0  # s, for a child to start, compile the engine and open the store, beyond the store's patience
BUSY = 60.0  # s, that a run may take beyond its limit, on a machine with too much to do
# Signals that operators and the operating system send too, so that they do not prove the run guilty.
AMBIGUOUS = {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
TRIES = 5  # processes that a run must end one after the other to be guilty, if the cause may be another one
TIMEOUTS = 2  # processes whose time limit it must exceed: one that was paused runs out of time too
STARTS = 10  # attempts at a process that fails on its own
PAUSES = (0.5, 8.0)  # s, the first and the longest between two processes; each is twice as long as the one before


@dataclass(frozen=True)
class _Ending:
    """How a child ended.

    Attributes
    ----------
    rows : int
        Rows that it sent.
    kind, content
        Its last message, see `campaign.worker.isolated_child`; the kind is empty if it sent none.
    exit_status : int
        As of `subprocess.Popen.wait`.
    hung : bool
        Whether it was killed because it hung.
    """

    rows: int
    kind: str
    content: Any
    exit_status: int
    hung: bool = False

    @property
    def in_run(self) -> bool:
        """Whether a run had begun that did not end."""
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
    """Yield the row of each sample, computed in a child process; a child that ends too early is replaced by another.

    Parameters
    ----------
    address : CampaignAddress
        The campaign.
    samples : sequence of int
        Numbers of the samples.
    attempt : int
        Attempt number of the batch, from 1.

    Yields
    ------
    Row
        One for each sample, in the order of ``samples``; of a run that is to blame for the end of its process too.

    Raises
    ------
    Cancelled
        If the campaign is cancelled meanwhile.
    WrongBuild, StoreError
        If the campaign cannot be read; see `campaign.worker.runs.read_campaign`.
    ChildFailed
        If `STARTS` children in a row fail for reasons of their own.
    """
    _, plan = read_campaign(address)
    deaths = alone = failures = 0  # children that ended in the next run; in their first run; for reasons of their own
    while samples:
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
    """Yield the rows of one child, of which none takes more than ``longest`` seconds; return how it ended."""
    ready_within = READY_WITHIN + address.patience.seconds
    rows, kind, content = 0, "", None
    try:
        child = _start_child()
    except OSError as error:
        return _Ending(0, "failed", error, 0)
    with child, ChildWatch(child, ready_within) as watch:
        for kind, content in _messages(child, (address, samples, attempt)):
            watch.heard(longest + BUSY if kind == "begun" else ready_within)
            if kind == "row":
                yield content
                rows += 1
        child.wait()
    return _Ending(rows, kind, content, child.returncode, watch.hung)


def _start_child() -> "subprocess.Popen[bytes]":
    """Start a child; Ctrl-C does not reach it, and it imports what this process can, from no current folder."""
    return subprocess.Popen(
        COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=python_environment(), start_new_session=True
    )


def _messages(child: "subprocess.Popen[bytes]", request: object) -> Iterator[tuple[str, Any]]:
    """Send a child what to compute, and yield its messages until it ends; an incomplete one is dropped."""
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
        except Exception:  # bytes that are no message raise anything
            child.kill()
            return
        yield kind, content


def _raise_failure(ending: _Ending, failures: int) -> None:
    """Raise the error of a child that failed, if another child would meet it too or enough of them have failed."""
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
    """Return what a run did to its process."""
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
    """Wait, the longer the more often it failed."""
    first, longest = PAUSES
    time.sleep(min(first * 2.0 ** (failures - 1), longest))
