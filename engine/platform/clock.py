"""The clock that ends runs at their real-time limit: one thread for all runs of a process."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from time import monotonic
from typing import Any


@dataclass(eq=False)
class _Limit:
    """The time at which a flag that is still zero gets a value."""

    end: float
    flag: Any
    value: int


class _Clock:
    """The limits in force, and the thread that watches them."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.limits: set[_Limit] = set()
        self.wakes = -inf  # time at which the thread looks next; -inf: the thread does not run yet

    def add(self, limit: _Limit) -> None:
        with self.changed:
            self.limits.add(limit)
            if self.wakes == -inf:
                threading.Thread(target=self.watch, name="clock", daemon=True).start()
                self.wakes = inf
            elif limit.end < self.wakes:  # rare: the limit of the next run usually ends after the previous one
                self.changed.notify()

    def remove(self, limit: _Limit) -> None:
        with self.changed:
            self.limits.discard(limit)

    def watch(self) -> None:
        """Set each flag when its time has come; never return."""
        with self.changed:
            while True:
                now = monotonic()
                for limit in [limit for limit in self.limits if limit.end <= now]:
                    self.limits.remove(limit)
                    limit.flag[0] = limit.flag[0] or limit.value
                self.wakes = min((limit.end for limit in self.limits), default=inf)
                self.changed.wait(None if self.wakes == inf else min(self.wakes - now, threading.TIMEOUT_MAX))


_clock = _Clock()


def _begin_anew() -> None:
    """Discard the clock inherited from the parent process after a fork: its thread does not exist here."""
    global _clock
    _clock = _Clock()


os.register_at_fork(after_in_child=_begin_anew)


@contextmanager
def set_after(seconds: float, flag: Any, value: int) -> Iterator[None]:
    """Set a flag, shape (1,), that is still zero if the block takes longer than a real time [s]; never after it."""
    clock, limit = _clock, _Limit(monotonic() + seconds, flag, value)
    clock.add(limit)
    try:
        yield
    finally:
        clock.remove(limit)
