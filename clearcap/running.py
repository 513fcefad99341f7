"""Have a verb of the command compute a campaign, in a process of its own, and follow it from Python to its end.

Functions of the caller are told how far it is, and its rows as they are finished.
"""

import signal
import subprocess
import sys
import warnings
from collections import deque
from collections.abc import Callable
from threading import Lock, Thread
from typing import TYPE_CHECKING, Protocol, TextIO

from campaign.coordinator.heartbeat import Heartbeat, Observation, observe
from campaign.coordinator.lease import HEARTBEAT_INTERVAL
from campaign.errors import CampaignError, SpecError, UnreachableError
from campaign.plan import Plan
from campaign.processes import STORE
from campaign.store import Store
from campaign.store.parts import batches_of, folder
from clearcap.analysed import framed
from engine.platform.child import python_environment

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

INTERRUPTED = 130  # exit status of the command after Ctrl-C
ENDS_WITHIN = 60.0  # s, time for an interrupted coordinator to release its lease and its workers
_ERRORS: dict[int, type[CampaignError]] = {2: SpecError, 4: UnreachableError}
_PREFIX = "clearcap: "

Rows = Callable[["pd.DataFrame"], None]


class Follows(Protocol):
    """What follows a campaign: it is called with each new heartbeat, and its `rows` with finished rows."""

    def __call__(self, beat: Heartbeat, /) -> None:
        """Take a heartbeat."""

    def rows(self, rows: "pd.DataFrame", /) -> None:
        """Take a table of finished rows."""


Progress = bool | Callable[[Heartbeat], None] | Follows


class Follower:
    """Tells functions how far a campaign is, at each new heartbeat, and its finished rows, each once."""

    def __init__(self, store: Store, plan: Plan, progress: Progress = False, rows: Rows | None = None) -> None:
        self._store, self._plan = store, plan
        self._rows: Rows | None = rows or getattr(progress, "rows", None)
        self._show = progress if callable(progress) else None
        self._beat: Heartbeat | None = None
        self._read: set[int] = set()  # batches
        self._tables: deque[pa.Table] = deque()  # still to be told
        self._last: Observation | None = None
        self._looks = Lock()  # two may await one campaign, and a thread outlives the await that was cancelled

    def look(self) -> Observation:
        """Read progress and new rows from the store; this may be another thread than that of `tell`."""
        with self._looks:
            # first the state: when it says that all is computed, all rows are there
            self._last = seen = observe(self._store, self._plan.campaign_id, self._last)
            if self._rows is not None:
                self._read_rows()
        return seen

    def _read_rows(self) -> None:
        """Read the batches that were not read before; files that are bad are, once they are computed again."""
        spans = (batches_of(name, self._plan) for name in self._store.files.names(folder(self._plan)))
        found = {batch for span in spans if span for batch in range(span[0], span[1] + 1)} - self._read
        starts = {self._plan.batches[batch][0]: batch for batch in found}
        for table in self._store.stream(self._plan, None, found) if found else ():
            self._tables.append(table)
            self._read.update(starts[n] for n in table["sample"].to_pylist() if n in starts)

    def tell(self) -> None:
        """Call the user's functions with the news that `look` has read."""
        while self._tables:  # one by one: what a function raises leaves the others for the next call
            table = self._tables.popleft()
            if self._rows is not None and table.num_rows:
                self._rows(framed(table, "sample"))
        beat = None if self._last is None else self._last.heartbeat
        if self._show is not None and beat is not None and beat != self._beat:
            self._show(beat)
        self._beat = beat


def compute(store: Store, plan: Plan, verb: str, options: list[str], progress: Progress) -> None:
    """Compute a planned campaign with a verb of the command; raises the errors of `clearcap.run_campaign`."""
    command = [sys.executable, "-P", "-m", "clearcap", verb, plan.campaign_id, "--no-report", "--json"]
    environment = {**python_environment(), STORE: store.files.full_url}  # unlike arguments, hidden from other users
    nothing, pipe = subprocess.DEVNULL, subprocess.PIPE
    process = subprocess.Popen(
        [*command, *options], stdin=nothing, stdout=nothing, stderr=pipe, env=environment, text=True, errors="replace"
    )
    with process:
        try:
            if callable(progress):
                message = _observed(process, Follower(store, plan, progress))
            else:
                message = _follow(process, sys.stderr if progress else None)
        except BaseException:  # of a function that is told, too
            # end cleanly: a Ctrl-C in a terminal reached the process too, a notebook's interrupt did not
            process.send_signal(signal.SIGINT)
            try:
                process.wait(ENDS_WITHIN)
            except subprocess.TimeoutExpired:
                process.kill()
            raise
    if process.returncode == INTERRUPTED:
        raise KeyboardInterrupt
    if process.returncode == 1 and not store.survey(plan).missing:
        warnings.warn(message, stacklevel=3)
    elif process.returncode:
        raise _ERRORS.get(process.returncode, CampaignError)(message)


def _observed(process: "subprocess.Popen[str]", follower: Follower) -> str:
    """Call the user's functions, in this thread, with news until the process ends; return its last message."""
    said: list[str] = []
    reader = Thread(target=lambda: said.append(_follow(process, None)), daemon=True)
    reader.start()
    has_ended = False
    while not has_ended:
        reader.join(HEARTBEAT_INTERVAL / 2)
        has_ended = not reader.is_alive()
        follower.look()
        follower.tell()
    return said[0]


def _follow(process: "subprocess.Popen[str]", progress: TextIO | None) -> str:
    """Forward the output of the process until it ends; return its last message, or everything after its last error."""
    message = ""
    for line in process.stderr or ():
        if progress is not None:
            progress.write(line)
            progress.flush()
        is_new = line.startswith(_PREFIX) or not line.startswith(" ")
        message = line.removeprefix(_PREFIX) if is_new else message + line
    process.wait()
    return message.removeprefix("error: ").strip() or f"the coordinator ended with status {process.returncode}"
