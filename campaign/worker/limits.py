"""Limits of a run: real time, memory, cancellation of its campaign, and the end of the parent process."""

import os
import resource
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from engine.loop import Cancel

CHECK_INTERVAL = 2.0  # s between two checks whether the campaign is cancelled
GIB = 1 << 30


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Kill this process with SIGALRM if the block takes longer than ``seconds``.

    The engine ends a run at its own time limit. This limit is for code that ignores that one: the operating system's
    timer needs neither the interpreter nor its lock.
    """
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


@contextmanager
def memory_limit(gib: float) -> Iterator[None]:
    """Make allocations in the block fail with MemoryError once this process has more than ``gib`` GiB of data."""
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = int(gib * GIB)
    resource.setrlimit(resource.RLIMIT_DATA, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@contextmanager
def cancelled_by(is_cancelled: Callable[[], bool], cancel: "Cancel") -> Iterator[None]:
    """Set ``cancel`` when ``is_cancelled`` returns True; a thread calls it every two seconds during the block."""
    over = threading.Event()

    def check() -> None:
        while not over.wait(CHECK_INTERVAL):
            try:
                if is_cancelled():
                    cancel.set()
                    return
            except Exception:  # the store cannot be reached: writing the batch will report it
                continue

    watcher = threading.Thread(target=check, name="cancel", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()


def end_with(pipe: BinaryIO) -> None:
    """End this process when a pipe is closed, which happens when the process at its other end ends."""

    def wait() -> None:
        while pipe.read(4096):
            pass
        os._exit(1)

    threading.Thread(target=wait, name="parent", daemon=True).start()
