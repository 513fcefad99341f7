"""Limits of a run: real time, and cancellation of its campaign."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from engine.loop import Cancel

CHECK_INTERVAL = 2.0  # s between two checks whether the campaign is cancelled


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
