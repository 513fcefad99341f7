"""Workers on this machine: a local dask cluster of single-threaded processes, silent and closed to other users.

Scheduler and workers listen on loopback, where every user of the machine can connect to them. So they use mutual TLS
with certificates that exist only in memory and only during the run, and no HTTP server.

Dask's `LocalCluster` starts, watches and replaces the workers, so that a campaign here takes the same way as one on a
cluster. Its `Security.temporary` is not used: those certificates are valid from now on, and would lock out a worker
that replaces a dead one after the clock was set back. Its scratch folder and HTTP server are open to other users, and
it leaves half a cluster behind if a signal comes while it starts; hence the rest of this module.
"""

import fcntl
import logging
import os
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import active_children, resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import FrameType

import dask
from distributed import Client, LocalCluster, Security
from distributed.system import MEMORY_LIMIT

from campaign.cluster.tls_certificates import passing_security
from campaign.errors import UnreachableError
from campaign.safe_path import current_folder_left_out
from campaign.waits import counted

logger = logging.getLogger(__name__)

STARTS = 3  # attempts to start the workers
STARTS_WITHIN = 120.0  # s for a worker to start, on a machine that starts many at once

# Keys are dotted, because setting a whole table would replace it. Independent tasks need neither stealing nor
# rebalancing, and results are counts, which never need spilling to disk.
SETTINGS = {
    "distributed.scheduler.allowed-failures": 0,  # the coordinator repeats a batch that ends its worker, isolated
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.scheduler.worker-ttl": None,  # would take a machine that slept for a hanging worker; see `Liveness`
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.worker.memory.pause": 0.85,
    "distributed.worker.memory.terminate": 0.95,
    # By default dask monitors itself 50 times a second in each process, which takes 5 % of two cores.
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.comm.timeouts.connect": "30s",
    "distributed.comm.timeouts.tcp": "30s",
    "distributed.nanny.pre-spawn-environ.PYTHONSAFEPATH": 1,
    "distributed.nanny.pre-spawn-environ.OMP_NUM_THREADS": 1,
    "distributed.nanny.pre-spawn-environ.MKL_NUM_THREADS": 1,
    "distributed.nanny.pre-spawn-environ.OPENBLAS_NUM_THREADS": 1,
    "distributed.nanny.pre-spawn-environ.NUMBA_NUM_THREADS": 1,
    "distributed.nanny.pre-spawn-environ.DASK_LOGGING__DISTRIBUTED": "critical",
}
NO_DASHBOARD = "campaign.cluster.disable_dashboard"  # module that dask loads into a process to close its HTTP server
CLOSED = {
    f"distributed.{service}.{key}": value
    for service in ("scheduler", "worker")
    for key, value in {"preload": [NO_DASHBOARD], "preload-argv": [], "http.routes": []}.items()
}
# modules that workers of this machine load while the coordinator is still planning; given by name, because this
# package does not import `campaign.worker`
PRELOAD = {"distributed.worker.preload": [NO_DASHBOARD, "campaign.worker.preload"]}
PREFIX = "clearcap-scratch-"


@contextmanager
def local_client(workers: int, security: Security | None = None) -> Iterator[Client]:
    """Start ``workers`` processes, and yield a dask client to them; without certificates there are passing ones."""
    # Each worker and this process may use an equal share of the memory; a worker that takes more is restarted.
    security = security or passing_security()
    settings = {**SETTINGS, **CLOSED, **PRELOAD}
    with scratch_folder() as scratch, dask.config.set({**settings, "temporary-directory": str(scratch)}):
        earlier = active_children()
        cluster = _start(workers, security)
        try:
            with interrupts_held():
                client = Client(cluster, set_as_default=False)  # type: ignore[no-untyped-call]
            try:
                yield client
            finally:
                client.close()  # type: ignore[no-untyped-call]
        finally:
            cluster.close()
            _end_children_but(earlier)


def _start(workers: int, security: Security) -> LocalCluster:
    """Return a cluster with running workers; try again if a worker dies or hangs while it starts."""
    earlier = active_children()
    for attempt in range(1, STARTS + 1):
        try:
            with interrupts_held():
                return LocalCluster(  # type: ignore[no-untyped-call]  # distributed is annotated in parts
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    protocol="tls://",
                    security=security,
                    memory_limit=MEMORY_LIMIT // (workers + 1),
                    death_timeout=STARTS_WITHIN,
                    scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},  # 8787 may be taken
                    silence_logs=logging.CRITICAL,
                )
        except Exception as error:  # dask raises errors of many classes
            _end_children_but(earlier)
            reason = str(error.__cause__ or error) or type(error).__name__
            if attempt == STARTS:
                raise UnreachableError(
                    f"{counted(workers, 'worker')} cannot be started here: {reason}, {STARTS} times in a row; find out"
                    " what ends them (memory? a process limit?), and try fewer: --workers N"
                ) from error
            logger.warning("the workers of this machine did not start (%s); trying again", reason)
    raise AssertionError


def _end_children_but(earlier: list[BaseProcess]) -> None:
    """Kill the child processes that were started after ``earlier`` and that dask has lost track of."""
    for process in set(active_children()) - set(earlier):
        process.kill()
        process.join()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold back signals that end this process during the block, because half a cluster could not be stopped cleanly."""
    # A terminal sends Ctrl-C and its hangup to every process, but only the process that talks to the user should react;
    # so threads and processes started in the block never receive them.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    try:
        with current_folder_left_out():
            resource_tracker.ensure_running()  # if started later, it would unblock Ctrl-C again
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        with _termination_held():
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _termination_held() -> Iterator[None]:
    """Delay SIGTERM until after the block; processes started in the block can still be terminated."""
    handler = signal.getsignal(signal.SIGTERM)
    if not callable(handler) or threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[FrameType | None] = []
    signal.signal(signal.SIGTERM, lambda _, frame: held.append(frame))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, handler)
        if held:
            handler(signal.SIGTERM, held[0])


# -- the folder for temporary files of one run, closed to other users and removed however the run ends -----------------
#
# Dask puts its scratch folder first on the import path. By default that is ``/tmp/dask-scratch-space``, which any user
# of the machine may have prepared; so each run gets a folder of its own, with an unpredictable name.


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Make a folder of mode 0700 and yield it; remove it at the end, and folders of killed runs at the start."""
    parent = Path(tempfile.gettempdir())
    _remove_abandoned(parent)
    try:
        folder, lock = _locked_folder(parent)
    except OSError as error:
        raise UnreachableError(
            f"{parent}: no folder for temporary files can be made there ({error.strerror}); free space, or set TMPDIR"
        ) from error
    try:
        yield folder
    finally:
        sys.path[:] = [entry for entry in sys.path if not Path(entry).is_relative_to(folder)]
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def _locked_folder(parent: Path) -> tuple[Path, int]:
    """Return a new folder and its lock, which the system releases when this process ends."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
        with suppress(FileNotFoundError):  # another run mistook it for abandoned before it was locked
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            fcntl.flock(lock, fcntl.LOCK_EX)
            if folder.exists():
                return folder, lock
            os.close(lock)


def _remove_abandoned(parent: Path) -> None:
    """Remove the folders of this user's killed runs, recognized because no process holds their locks."""
    for folder in parent.glob(f"{PREFIX}*"):
        with suppress(OSError):  # of another user, removed meanwhile, or locked by a running process
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                if os.fstat(lock).st_uid == os.getuid():
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(lock)
