"""End a child process that hangs, because somebody stopped it or its run ignores its time limit."""

import logging
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType

logger = logging.getLogger(__name__)

LOOK_INTERVAL = 2.0  # s between two checks


class ChildWatch:
    """A context in which a thread kills a child that sends nothing for too long, checking every two seconds.

    Only time while this process is awake counts: a check adds at most twice the interval between checks, so that the
    child is not blamed if a laptop sleeps or all processes of a campaign are stopped.

    The child leads a session of its own, and the processes that it started are killed with it. It may be silent for
    ``allowed`` seconds at first. `hung` says whether it was killed for its silence.
    """

    def __init__(
        self, child: "subprocess.Popen[bytes]", allowed: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.hung = False
        self._child, self._clock = child, clock
        self._last = self._seen = (0, allowed)  # number of messages; how long the child may be silent now
        self._silent_for = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="silent child", daemon=True)

    def __enter__(self) -> "ChildWatch":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def heard(self, allowed: float) -> None:
        """Record that the child has sent a message, after which it may be silent for ``allowed`` seconds."""
        self._last = (self._last[0] + 1, allowed)

    def is_silent(self, passed: float) -> bool:
        """Return whether the child has been silent for too long, ``passed`` seconds after the last check."""
        if self._last != self._seen:
            self._seen, self._silent_for = self._last, 0.0
        else:
            self._silent_for += min(passed, 2.0 * LOOK_INTERVAL)
        return self._silent_for > self._seen[1]

    def _watch(self) -> None:
        looked_at = self._clock()
        while not self._over.wait(LOOK_INTERVAL):
            now = self._clock()
            if self.is_silent(now - looked_at):
                self._end()
                return
            looked_at = now

    def _end(self) -> None:
        self.hung = True
        logger.warning(
            "the process that computes runs in isolation sends nothing for %.0f s: it hangs or was stopped, is killed,"
            " and its run is tried again",
            self._silent_for,
        )
        with suppress(ProcessLookupError):  # it ended at this moment
            os.killpg(self._child.pid, signal.SIGKILL)
