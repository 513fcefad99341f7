"""What systemd does for a campaign: start processes, start them again when they end, and nothing else."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

# In the environment of all processes of a storm, by which orphans are found; a server passes on what begins so.
MARK = "PYTHON_CLEARCAP_STORM"
END_WITHIN = 600.0  # s, in which all members end; a server waits for its coordinator, and that for its workers
ROOT = Path(__file__).parents[3]


@dataclass
class Life:
    """One process of a member, from its start to its end.

    Attributes
    ----------
    name : str
        Of the member.
    process : Popen
        With its exit status once it has ended.
    log : Path
        The file that takes what it writes.
    first, last : int
        Where in this file that begins, and ends once it has ended.
    """

    name: str
    process: subprocess.Popen
    log: Path
    first: int
    last: int | None = None

    def text(self):
        """Return what it wrote."""
        return self.log.read_bytes()[self.first : self.last].decode(errors="replace")


class Supervisor:
    """Keeps processes alive until it is told to stop; one that ends with 0 may stay down.

    Parameters
    ----------
    folder : Path
        Where they write what they say, a file each.
    mark : str
        Distinguishes their environment from every other.
    environment : dict of str to str
        What they have besides that of this process.
    """

    def __init__(self, folder, mark, **environment):
        self.folder, self.mark = folder, mark
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        self.environment = {**os.environ, MARK: mark, "PYTHONPATH": path, **environment}
        self._members, self._once, self._delays = {}, set(), {}
        self._running, self._ended, self.codes, self.lives = {}, {}, {}, []
        self.stopped = set()  # numbers of the processes that this ended, and not the campaign or the test
        self._holding = False
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def add(self, name, *module_and_arguments, once=False, after=0.2, prefix=()):
        """Start ``python -m ...`` and keep it; ``once``: until it ends with 0. ``after`` [s] it starts again."""
        with self._lock:
            self._members[name] = [*prefix, sys.executable, "-m", *map(str, module_and_arguments)]
            self._delays[name] = after
            if once:
                self._once.add(name)
            self._start(name)

    def pid(self, name):
        """Return the process number of a member, None while it is down."""
        with self._lock:
            return self._running[name].pid if name in self._running else None

    def finished(self, name):
        """Return whether a member that runs once has ended with 0."""
        return self.codes.get(name, [None])[-1] == 0

    @contextmanager
    def held(self):
        """Start nothing again meanwhile."""
        self._holding = True
        try:
            yield
        finally:
            self._holding = False

    def said(self, name):
        """Return the end of what a member wrote."""
        return (self.folder / f"{name}.log").read_text(errors="replace")[-4000:]

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()
        until = time.monotonic() + END_WITHIN
        for name in reversed(self._members):  # a worker whose scheduler ends first waits 8 s for it
            if (process := self._running.get(name)) is None:
                continue
            self.stopped.add(process.pid)
            process.terminate()
            try:
                process.wait(max(until - time.monotonic(), 0.1))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _start(self, name):
        path = self.folder / f"{name}.log"
        with path.open("ab") as log:
            process = subprocess.Popen(
                self._members[name],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=self.environment,
                start_new_session=True,
            )
            self._running[name] = process
            self.lives.append(Life(name, process, path, log.tell()))

    def _look(self):
        while not self._over.wait(0.05):
            with self._lock:
                for name, process in list(self._running.items()):
                    if (code := process.poll()) is not None:
                        self.codes.setdefault(name, []).append(code)
                        del self._running[name]
                        life = next(life for life in reversed(self.lives) if life.name == name)
                        life.last = life.log.stat().st_size
                        self._ended[name] = time.monotonic()
                for name in () if self._holding else self._members.keys() - self._running.keys():
                    if name in self._once and self.codes[name][-1] == 0:
                        continue
                    if time.monotonic() - self._ended[name] >= self._delays[name]:
                        self._start(name)


def processes(mark):
    """Return the living processes that have a mark in their environment."""
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if process.environ().get(MARK) == mark and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def those_left(mark, within=600.0):
    """Return what processes with a mark there are after some time [s] in which the last ones may end."""
    until = time.monotonic() + within
    while (left := processes(mark)) and time.monotonic() < until:
        time.sleep(0.1)
    return [command for process in left if (command := words(process))]


def words(process):
    """Return the command line of a process; empty if it is gone by now."""
    try:
        return process.cmdline() if process.is_running() else []
    except psutil.Error:
        return []


def kill(pid):
    """Kill -9 a process, if it is there."""
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
