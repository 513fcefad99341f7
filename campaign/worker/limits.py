"""What keeps a run within its bounds: of real time, of memory, and of the user's patience."""

import os
import resource
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from engine.loop import Cancel

LOOK_EVERY = 2.0  # s, for the marker that cancels
GIB = 1 << 30


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """End this process if what is inside takes longer than ``seconds``, whatever it does.

    The engine ends a run at its own limit. This is for what takes no notice: the kernel's timer needs neither the
    interpreter nor its lock, and its signal kills (SIGALRM).
    """
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


@contextmanager
def memory_limit(gib: float) -> Iterator[None]:
    """Let allocations fail (MemoryError) that would take this process beyond ``gib`` GiB of data."""
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    asked = int(gib * GIB)
    resource.setrlimit(resource.RLIMIT_DATA, (asked if hard == resource.RLIM_INFINITY else min(asked, hard), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@contextmanager
def cancelled_by(asked: Callable[[], bool], cancel: "Cancel") -> Iterator[None]:
    """Set ``cancel`` as soon as ``asked`` says so; it is asked now and then, in a thread of its own."""
    over = threading.Event()

    def look() -> None:
        while not over.wait(LOOK_EVERY):
            try:
                wanted = asked()
            except Exception:  # a store that cannot be reached says nothing; the batch will
                continue
            if wanted:
                cancel.set()
                return

    watcher = threading.Thread(target=look, name="cancel", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()


def end_with_stdin() -> None:
    """End this process when its standard input is closed, that is, when the process that started it is gone."""

    def wait() -> None:
        while os.read(0, 4096):
            pass
        os._exit(1)

    threading.Thread(target=wait, name="parent", daemon=True).start()
