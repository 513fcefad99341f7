"""A cache of answers as bytes, and a way to compute an answer once for simultaneous equal questions."""

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Coroutine
from dataclasses import dataclass

from clearcap.web.answers.fair_queue import Busy

_OVERHEAD = 500  # bytes of the key and its entry


class ResponseCache:
    """A cache of the most recently used answers, of at most `at_most` bytes together."""

    def __init__(self, at_most: int) -> None:
        self._at_most, self._size = at_most, 0
        self._answers: OrderedDict[str, bytes] = OrderedDict()

    def get(self, key: str) -> bytes | None:
        """Return an answer; None if it is not in the cache."""
        found = self._answers.get(key)
        if found is not None:
            self._answers.move_to_end(key)
        return found

    def put(self, key: str, answer: bytes) -> None:
        """Keep an answer; drop the least recently used ones if the cache is full."""
        self._size -= _size(self._answers.pop(key, None))
        self._answers[key] = answer
        self._size += _size(answer)
        while self._size > self._at_most:
            _, oldest = self._answers.popitem(last=False)
            self._size -= _size(oldest)


def _size(answer: bytes | None) -> int:
    """Return the memory that an answer takes [bytes]."""
    return 0 if answer is None else len(answer) + _OVERHEAD


@dataclass
class _Flight:
    """A computation in progress, and the number of calls that wait for it."""

    task: "asyncio.Task[bytes]"
    waiting: int = 0


class SingleFlight:
    """Compute an answer once for simultaneous equal questions; cancel it when nobody waits for it any more."""

    def __init__(self) -> None:
        self._flights: dict[str, _Flight] = {}

    async def once(self, key: str, compute: Callable[[], Coroutine[None, None, bytes]]) -> bytes:
        """Return the result of ``compute``, or that of a computation in progress with the same key.

        Raises Busy only if this call's own computation is refused; if that of another user is, this call tries again.
        """
        while True:
            flight = self._flights.get(key)
            is_own = flight is None
            if flight is None:
                flight = self._flights[key] = _Flight(asyncio.get_running_loop().create_task(compute()))
                flight.task.add_done_callback(lambda task: self._forget(key, task))
            flight.waiting += 1
            try:
                return await asyncio.shield(flight.task)  # a caller that leaves must not cancel the others' answer
            except Busy:
                if is_own:
                    raise
            finally:
                flight.waiting -= 1
                if not flight.waiting and not flight.task.done():
                    flight.task.cancel()
                    self._forget(key, flight.task)

    def _forget(self, key: str, task: "asyncio.Task[bytes]") -> None:
        """Drop a finished computation, so that the next call computes again."""
        if key in self._flights and self._flights[key].task is task:
            del self._flights[key]
