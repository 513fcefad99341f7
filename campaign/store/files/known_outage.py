"""What is known of a store that does not answer: of many who must not wait for it, only one asks it at a time."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

from campaign.errors import StoreError

LONG = 1.0  # s, after which a fault has kept somebody waiting
ASK_EVERY = 1.0  # s, between two questions to a store that does not answer


class KnownOutage:
    """Shared by all threads that ask a store for somebody who must not wait, such as those of a server.

    A server of files that is overloaded or cut off refuses nothing: each question to it takes seconds until it is given
    up. Once that has happened, one thread goes on to ask, and all others fail at once with its fault, until the store
    answers again. Faults that come at once, such as a missing permission, keep nobody waiting and are not remembered.
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
        """Ask the store in the block.

        Raises
        ------
        StoreError
            At once, if the store is known not to answer, and another thread asks it now or has just done so.
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
        """Take note of how a question ended."""
        if not (fault or self._fault):
            return
        with self._lock:
            self._fault, self._is_asked, self._asked_at = fault, False, time.monotonic()
