"""A throttle that slows down guessing of passwords and tokens: after some failures no more are checked for a while."""

import ipaddress
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable

MOST_KEYS = 10_000  # names and addresses that are kept; the oldest are dropped
WIDER = 10  # times as many failures of one name from all addresses, or of one address with all names, are allowed


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

        Counted at once, many at a time cannot pass before the first has failed. If one key has to wait, none is noted.
        """
        with self._lock:
            wait, now = self._wait(keys), self._clock()
            for key in () if wait else keys:
                self._failures.setdefault(key, deque(maxlen=self._most)).append(now)
                self._failures.move_to_end(key)
            while len(self._failures) > MOST_KEYS:
                self._failures.popitem(last=False)
        return wait

    def take_back(self, *keys: str) -> None:
        """Take back the last failure of each key."""
        with self._lock:
            for key in keys:
                if self._failures.get(key):
                    self._failures[key].pop()

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


class LoginThrottle:
    """Failed logins by name and address together, so that one who guesses locks out neither a user nor an office.

    Guesses at one name from many addresses, and at many names from one address, have limits too; they do not hold for
    users where they have logged in before.
    """

    def __init__(self, failures: int, seconds: float) -> None:
        self._narrow, self._wide = Throttle(failures, seconds), Throttle(WIDER * failures, seconds)
        self._known: OrderedDict[str, None] = OrderedDict()  # names and addresses of successful logins

    def attempt(self, name: str, address: str) -> float:
        """Note an attempt as a failure until it `succeeded` or is taken back; return the time to wait [s]."""
        both = f"{name} {place_of(address)}"
        wait = self._narrow.wait(both)
        if not wait and both not in self._known:
            wait = self._wide.attempt(*_each(name, address))
        return wait or self._narrow.attempt(both)

    def succeeded(self, name: str, address: str) -> None:
        """Forget the failures of a name at an address, and remember that it belongs there."""
        both = f"{name} {place_of(address)}"
        self._narrow.succeeded(both)
        self._take_back_wide(name, address)
        self._known[both] = None
        self._known.move_to_end(both)
        while len(self._known) > MOST_KEYS:
            self._known.popitem(last=False)

    def take_back(self, name: str, address: str) -> None:
        """Take back the last attempt, because the password was not checked."""
        self._narrow.take_back(f"{name} {place_of(address)}")
        self._take_back_wide(name, address)

    def _take_back_wide(self, name: str, address: str) -> None:
        """Take back the last attempt where `attempt` has noted it."""
        if f"{name} {place_of(address)}" not in self._known:
            self._wide.take_back(*_each(name, address))


def _each(name: str, address: str) -> tuple[str, str]:
    """Return the keys of a name at all addresses and of an address with all names."""
    return f"name {name}", f"address {place_of(address)}"
