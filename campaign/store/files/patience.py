"""How long operations on a store may take and are tried again: one policy for folders and URLs."""

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass
from random import uniform

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Patience:
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


PATIENT = Patience(180.0)  # for computing: an outage of minutes must not end a night's work
QUICK = Patience(10.0, answer=10.0)  # for commands that only read
HASTY = Patience(0.0, answer=8.0)  # for callers that must not wait: they are ending, or try again by themselves


class Outage:
    """A period in which operations on a store fail: logs one message when it begins and one when it ends."""

    def __init__(self, store: str, patience: Patience) -> None:
        self._store, self._patience = store, patience
        self._since: float | None = None

    @property
    def too_long(self) -> bool:
        """Whether the outage has lasted longer than the patience."""
        return self._since is not None and time.monotonic() - self._since > self._patience.seconds

    def begin(self, fault: object) -> None:
        """Record a fault, given as a message that names the store; log it if it is the first."""
        if self._since is None:
            self._since = time.monotonic()
            logger.info("%s; trying again for %.0f s", fault, self._patience.seconds)

    def end(self) -> None:
        """Record a success; log it if there was a fault before."""
        if self._since is not None:
            logger.info("store %s: answers again after %.0f s", self._store, time.monotonic() - self._since)
            self._since = None
