"""Workers on this machine: a local dask cluster of single-threaded processes, quiet and bound to loopback."""

import logging
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

import dask
from distributed import Client, LocalCluster, Security
from distributed.system import MEMORY_LIMIT

# Keys are dotted, because setting a whole table would replace it. Independent tasks need neither stealing nor
# rebalancing, and results are counts, which are never worth spilling to disk.
SETTINGS = {
    "distributed.scheduler.allowed-failures": 0,
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.worker.memory.pause": 0.85,
    "distributed.worker.memory.terminate": 0.95,
    # Dask watches itself 50 times a second in each process: a twentieth of what two cores can compute.
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.comm.timeouts.connect": "30s",
    "distributed.comm.timeouts.tcp": "30s",
    "distributed.nanny.pre-spawn-environ.OMP_NUM_THREADS": 1,
    "distributed.nanny.pre-spawn-environ.MKL_NUM_THREADS": 1,
    "distributed.nanny.pre-spawn-environ.OPENBLAS_NUM_THREADS": 1,
    "distributed.nanny.pre-spawn-environ.NUMBA_NUM_THREADS": 1,
    "distributed.nanny.pre-spawn-environ.DASK_LOGGING__DISTRIBUTED": "critical",
}


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def local_client(workers: int, security: Security | None = None) -> Iterator[Client]:
    """Start ``workers`` single-threaded processes and yield a dask client to them; stop them at the end.

    Each may use an equal share of the machine's memory, and this process has one share too. A worker that takes more is
    restarted, and its batch counts as one that killed its worker. The scratch folder is dask's: what killed workers
    left in it is removed at the next start.
    """
    quiet = dask.config.set(SETTINGS)
    with quiet:
        with interrupts_held():
            cluster = LocalCluster(  # type: ignore[no-untyped-call]  # distributed is annotated in parts
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                protocol="tls://" if security else "tcp://",
                security=security,
                memory_limit=MEMORY_LIMIT // (workers + 1),
                scheduler_kwargs={
                    "dashboard": False,
                    "dashboard_address": "127.0.0.1:0",
                },  # 8787 may be taken
                silence_logs=logging.CRITICAL,
            )
            client = Client(cluster, set_as_default=False)  # type: ignore[no-untyped-call]
        try:
            yield client
        finally:
            client.close()  # type: ignore[no-untyped-call]
            cluster.close()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Block Ctrl-C for this thread while the block runs, and for good for the threads and processes it starts.

    A terminal sends Ctrl-C to every process; only the one that talks to the user should react.
    """
    resource_tracker.ensure_running()  # started later, it would let Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
