"""Who computes: which workers have joined or are lost since the last look, said once, and remembered for a while."""

import logging
import time
from collections import Counter
from collections.abc import Iterable, Mapping

from campaign.waits import Wait, counted

REMEMBERED = 300.0  # s for which a lost worker is told of, unless it comes back before
MOST_HOSTS = 4  # named in one message

logger = logging.getLogger(__name__)

Who = tuple[str, str]  # name and host of a worker


class Roster:
    """The workers of a scheduler by address, and those that are lost; the first look only takes note of them."""

    def __init__(self) -> None:
        self._known: dict[str, Who] | None = None
        self._released: set[str] = set()  # names of workers that are not needed any more
        self._lost: dict[Who, float] = {}  # and when that was seen [s since 1970]

    def look(self, present: Mapping[str, Who], refused: Iterable[str]) -> None:
        """Compare with the last look, and log who has joined, restarted, or is lost; ``refused`` are not counted."""
        known, self._known = self._known, dict(present)
        if known is None or known == present:
            return
        joined = [who for address, who in present.items() if address not in known]
        gone = [who for address, who in known.items() if address not in present]
        left = len(present.keys() - set(refused))
        restarted = set(joined) & set(gone)
        new, lost = ([who for who in those if who not in restarted] for those in (joined, gone))
        lost = [who for who in lost if who[0] not in self._released]
        for who in joined:
            self._lost.pop(who, None)
        self._lost |= dict.fromkeys(lost, time.time())
        if restarted:
            logger.info("%s restarted", _named(sorted(restarted)))
        if new:
            logger.info("%s joined, %d now", _named(new), left)
        if lost:
            logger.warning("%s %s lost, %d left", _named(lost), "is" if len(lost) == 1 else "are", left)

    def release(self, names: Iterable[str]) -> None:
        """Take note of workers that end because nothing is left for them; nobody needs to hear of that."""
        self._released = set(names)

    def waits(self) -> list[Wait]:
        """Return the workers that were lost in the last minutes and are not back."""
        now = time.time()
        self._lost = {who: at for who, at in self._lost.items() if now - at < REMEMBERED}
        if not self._lost:
            return []
        return [Wait("lost", max(self._lost.values()), _named(sorted(self._lost)))]


def _named(workers: list[Who]) -> str:
    """Return workers in words: one by its name, several by their hosts."""
    if len(workers) == 1:
        name, host = workers[0]
        return f"worker {name} on {host}"
    hosts = Counter(host for _, host in workers).most_common()
    places = [f"{count} on {host}" for host, count in hosts[:MOST_HOSTS]]
    places += [f"the others on {counted(len(hosts) - MOST_HOSTS, 'host')}"] if len(hosts) > MOST_HOSTS else []
    return f"{counted(len(workers), 'worker')} ({', '.join(places)})"
