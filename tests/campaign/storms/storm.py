"""A storm: one campaign, the processes that compute it, and what is done to them."""

import json
import os
import signal
import time
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import psutil

from campaign.errors import CampaignError
from campaign.store import Store
from tests.campaign.storms.modes import Mode
from tests.campaign.storms.supervisor import Supervisor, processes, words
from tests.campaign.storms.visitors import Visitors

COORDINATES = {"run", "resume", "coordinate"}
COMMANDS = {"clearcap", "tests.campaign.storms.command"}
JOBS = "clearcap.web.jobs.process:compute"  # in the command line of the processes in which a server computes


@dataclass
class Storm:
    """A campaign in bad weather.

    Attributes
    ----------
    chance : Random
        Draws all that is random.
    supervisor : Supervisor
        Starts its processes.
    disk : Path
        The file system that holds the store, and nothing else.
    store : Store
        Where the campaign is.
    campaign : str
        Its id.
    mode : Mode
        How it is computed.
    signals : dict of int to set of Signals
        What was sent to each process.
    take_overs : int
        How often another coordinator got the lease of one that was paused.
    hits : list of (str, int, float)
        What hit something, how many processes or files, and when [s].
    accounts : Path or None
        Folder of what only the server keeps, in a mode that has one.
    visitors : Visitors or None
        Who uses it.
    """

    chance: Random
    supervisor: Supervisor
    disk: Path
    store: Store
    campaign: str
    mode: Mode
    signals: dict = field(default_factory=lambda: defaultdict(set))
    take_overs: int = 0
    hits: list = field(default_factory=list)
    accounts: Path | None = None
    visitors: Visitors | None = None
    began: float = field(default_factory=time.monotonic)
    _undo: list = field(default_factory=list)

    @property
    def folder(self):
        """The folder of the campaign in its store."""
        return Path(self.store.files.path(self.campaign))

    def processes(self):
        """Return the living processes by what they do.

        That is worker, nanny, scheduler, coordinator, child, server, job process or other.
        """
        found = defaultdict(list)
        living = processes(self.supervisor.mark)
        workers = {process.pid for process in living if "spawn_main" in " ".join(words(process))}
        for process in living:
            found[_role(process, workers)].append(process)
        return found

    def some(self, role, within):
        """Return one process of a role, waited for some time [s]; an empty list if there is none."""
        found = []
        self.wait(lambda: found.extend(self.processes()[role]) or found, within)
        return self.chance.sample(found, min(1, len(found)))

    def send(self, number, hit):
        """Send a signal to processes; return how many there were."""
        sent = 0
        for process in hit:
            with suppress(psutil.Error, OSError):
                self.signals[process.pid].add(number)
                if self.is_in_a_space_of_its_own(process):
                    self.signals[process.ppid()].add(number)  # it started this one, and ends as this one does
                process.send_signal(number)
                sent += 1
        return sent

    def is_in_a_space_of_its_own(self, process):
        """Return whether a process sees other process numbers than this one, as on another machine."""
        return os.stat(f"/proc/{process.pid}/ns/pid").st_ino != os.stat("/proc/self/ns/pid").st_ino

    def pause(self, hit, seconds):
        """Stop processes for a while; return how many."""
        stopped = self.send(signal.SIGSTOP, hit)
        self.undo_after(seconds, lambda: self.send(signal.SIGCONT, hit))
        return stopped

    def undo_after(self, seconds, undo):
        """Have something undone when so much time [s] has passed."""
        self._undo.append((time.monotonic() + seconds, undo))

    def undo(self, *, everything=False):
        """Undo what has lasted long enough, or everything; what a faulty disk does not let be undone waits for it."""
        while ready := [due for due in self._undo if everything or due[0] <= time.monotonic()]:
            refused = []
            for due in ready:
                self._undo.remove(due)
                try:
                    due[1]()
                except OSError:
                    refused.append(due)
            self._undo += refused
            if not everything:
                return
            if len(refused) == len(ready):
                raise OSError(f"{len(refused)} disturbances cannot be undone")

    def wait(self, ready, seconds):
        """Wait until ``ready()``, or the campaign is over, undoing what is due; return whether it is ready."""
        until = time.monotonic() + seconds
        while not ready():
            if self.is_over() or time.monotonic() > until:
                return False
            self.undo()
            time.sleep(0.05)
        return True

    def parts(self):
        """Return the files of finished batches."""
        with suppress(OSError):
            return sorted((self.folder / "parts").glob("*.parquet"))
        return []

    def is_over(self):
        """Return whether the campaign is complete."""
        return self.mode.is_over(self)

    def document(self, name):
        """Return a small file of the campaign; an empty one while it cannot be read."""
        try:
            return json.loads(self.store.files.hasty.read(f"{self.campaign}/{name}"))
        except (CampaignError, OSError, ValueError):
            return {}


def _role(process, workers):
    """Return what a process does."""
    line = words(process)
    if process.pid in workers:
        return "worker"
    if "distributed.cli.dask_worker" in line:
        return "nanny"
    if "distributed.cli.dask_scheduler" in line:
        return "scheduler"
    if not line or any("resource_tracker" in word for word in line) or os.path.basename(line[0]) == "unshare":
        return "other"
    if COMMANDS & set(line) and COORDINATES & set(line):
        return "coordinator"
    if COMMANDS & set(line) and "serve" in line:
        return "server"
    if any(JOBS in word for word in line):
        return "job process"
    with suppress(psutil.Error):
        if process.ppid() in workers:
            return "child"
    return "other"
