"""A throttle that slows down guessing of passwords and tokens: after some failures no more are checked for a while."""

import ipaddress
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable

MOST_KEYS = 10_000  # names and addresses that are kept; the oldest are dropped


def place_of(address: str) -> str:
    """Return the key that counts as one guesser: an IPv4 address, or the /64 network that an IPv6 host may own."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address
    return address if parsed.version == 4 else str(ipaddress.ip_network((parsed, 64), strict=False))


class Throttle:
    """Failures by key, a name or an address, in memory: after `failures` within `seconds` a key has to wait."""

    def __init__(self, failures: int, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._most, self._seconds, self._clock = failures, seconds, clock
        self._failures: OrderedDict[str, deque[float]] = OrderedDict()
        self._lock = threading.Lock()

    def wait(self, *keys: str) -> float:
        """Return the longest time that any of the keys still has to wait [s]; 0 if none has to."""
        with self._lock:
            return self._wait(keys)

    def attempt(self, *keys: str) -> float:
        """Note an attempt of each key as a failure until it is taken back; return the time to wait [s], see `wait`.

        Counting an attempt at once stops many simultaneous attempts from passing before the first one has failed.
        Nothing is noted if one of the keys has to wait.
        """
        with self._lock:
            wait = self._wait(keys)
            if not wait:
                self._note(keys)
        return wait

    def take_back(self, *keys: str) -> None:
        """Take back the last failure of each key."""
        with self._lock:
            for key in keys:
                if self._failures.get(key):
                    self._failures[key].pop()

    def failed(self, *keys: str) -> None:
        """Note a failure of each key."""
        with self._lock:
            self._note(keys)

    def succeeded(self, *keys: str) -> None:
        """Forget the failures of each key."""
        with self._lock:
            for key in keys:
                self._failures.pop(key, None)

    def _wait(self, keys: tuple[str, ...]) -> float:
        now = self._clock()
        times = [self._failures[key] for key in keys if key in self._failures]
        full = [past[0] + self._seconds - now for past in times if len(past) == self._most]
        return max([0.0, *full])

    def _note(self, keys: tuple[str, ...]) -> None:
        now = self._clock()
        for key in keys:
            self._failures.setdefault(key, deque(maxlen=self._most)).append(now)
            self._failures.move_to_end(key)
        while len(self._failures) > MOST_KEYS:
            self._failures.popitem(last=False)
