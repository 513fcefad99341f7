"""How failing operations on a store are tried again: for how long, and, by a circuit breaker, by how many callers."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from random import uniform
from threading import Lock

from campaign.errors import StoreError

LONG = 1.0  # s; a fault that takes longer has kept its caller waiting
ASK_EVERY = 1.0  # s between two requests to a store that does not answer

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RetryPolicy:
    """How long an operation is tried again after a fault that may pass."""

    seconds: float  # [s] from the first fault to the last attempt; 0 for one attempt only
    first: float = 0.5  # [s] the first pause between attempts; each is twice as long as the one before
    longest: float = 10.0  # [s] the longest pause
    answer: float = 60.0  # [s] that an attempt waits for a server, besides the time that the bytes of a file take

    def pauses(self) -> Iterator[float]:
        """Yield the pause before each further attempt [s], varied at random by up to a quarter."""
        end, pause = time.monotonic() + self.seconds, self.first
        while (left := end - time.monotonic()) > 0.0:
            yield min(pause * uniform(0.75, 1.25), left)
            pause = min(2.0 * pause, self.longest)


PATIENT = RetryPolicy(180.0)  # for computing: an outage of minutes must not end a night's work
QUICK = RetryPolicy(10.0, answer=10.0)  # for commands that only read
HASTY = RetryPolicy(0.0, answer=8.0)  # for callers that must not wait: they are ending, or try again by themselves


_listeners: list[Callable[[str], None]] = []


@contextmanager
def outages_told(listener: Callable[[str], None]) -> Iterator[None]:
    """Call a listener with the fault when an outage of a store begins in this process, with no words when it ends."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def _tell(fault: str) -> None:
    for listener in list(_listeners):
        listener(fault)


class Outage:
    """A period in which operations on a store fail: logs one message when it begins and one when it ends."""

    def __init__(self, store: str, policy: RetryPolicy) -> None:
        self._store, self._policy = store, policy
        self._since: float | None = None

    @property
    def too_long(self) -> bool:
        """Whether the outage has lasted longer than the policy allows."""
        return self._since is not None and time.monotonic() - self._since > self._policy.seconds

    def begin(self, fault: object) -> None:
        """Record a fault, given as a message that names the store; log it if it is the first."""
        if self._since is None:
            self._since = time.monotonic()
            logger.info("%s; trying again for %.0f s", fault, self._policy.seconds)
            _tell(str(fault))

    def end(self) -> None:
        """Record a success; log it if there was a fault before."""
        if self._since is not None:
            logger.info("store %s: answers again after %.0f s", self._store, time.monotonic() - self._since)
            self._since = None
            _tell("")


class CircuitBreaker:
    """An outage shared by all threads that ask a store for callers that must not wait, such as those of a server.

    A file server that is overloaded or cut off does not refuse requests: each takes seconds until it times out. Once
    that has happened, one thread goes on asking and all others fail at once with the same fault, until the store
    answers again. Immediate faults, such as a missing permission, keep nobody waiting and are not remembered.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._fault = ""
        self._is_asked, self._asked_at = False, 0.0

    @property
    def fault(self) -> str:
        """Why the store does not answer; empty while it does."""
        return self._fault

    @contextmanager
    def guarding(self) -> Iterator[None]:
        """Guard a block that asks the store; StoreError at once if it is known not to answer and was just asked."""
        begin = time.monotonic()
        with self._lock:
            if self._fault:
                if self._is_asked or begin - self._asked_at < ASK_EVERY:
                    raise StoreError(self._fault)
                self._is_asked = True
        try:
            yield
        except StoreError as error:
            self._answered(str(error) if time.monotonic() - begin > LONG else "")
            raise
        except BaseException:
            self._answered("")
            raise
        else:
            self._answered("")

    def _answered(self, fault: str) -> None:
        # the usual case needs no lock
        if not (fault or self._fault):
            return
        with self._lock:
            self._fault, self._is_asked, self._asked_at = fault, False, time.monotonic()
