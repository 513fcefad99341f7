"""Remember that a store does not answer, so that of many callers that must not wait only one asks it at a time."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

from campaign.errors import StoreError

LONG = 1.0  # s; a fault that takes longer has kept its caller waiting
ASK_EVERY = 1.0  # s between two requests to a store that does not answer


class KnownOutage:
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
    def asking(self) -> Iterator[None]:
        """Guard a block that asks the store.

        Raises StoreError at once if the store is known not to answer and another thread is asking it or has just done
        so.
        """
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
        """Record how a request ended."""
        # the usual case needs no lock
        if not (fault or self._fault):
            return
        with self._lock:
            self._fault, self._is_asked, self._asked_at = fault, False, time.monotonic()
