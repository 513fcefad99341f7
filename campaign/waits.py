"""What a running campaign waits for, as facts that its heartbeat has, and in the words that every face shows."""

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any

# in the order in which they are told; what stands in front keeps what follows from going on
SENTENCES = {
    "coordinator": "its coordinator no longer writes",  # said by who observes it, as it cannot say so itself
    "start": "starting workers for {t}",
    "compiling": "loading or compiling the engine for {t}",
    "scheduler": "no scheduler for {t}",
    "store": "the store has refused for {t}",
    "workers": "no workers for {t}",
    "jobs": "jobs have been waiting in the queue for {t}",
    "lost": "lost {t} ago",
    "idle": "nothing finished for {t}",
}
STOPPING = ("start", "compiling", "scheduler", "store", "workers")  # with one of these nothing is computed
LONGEST_DETAIL = 300  # characters


@dataclass(frozen=True)
class Wait:
    """One thing that a campaign waits for."""

    what: str  # a key of `SENTENCES`
    since: float  # by the clock of the coordinator [s since 1970]
    detail: str = ""  # the words of who refuses, the ids of jobs, the name of a worker

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def is_wait(content: object) -> bool:
    """Return whether plain data of unknown origin are those of a `Wait`."""
    return (
        isinstance(content, Mapping)
        and content.keys() == {"what", "since", "detail"}
        and isinstance(content["detail"], str)
        and content["what"] in SENTENCES
        and isinstance(content["since"], int | float)
        and not isinstance(content["since"], bool)
        and abs(content["since"]) < 1e12
    )


def in_words(waits: Iterable[Mapping[str, Any]], now: float) -> str:
    """Return what a campaign waits for, empty if nothing; ``now`` is the time of its heartbeat [s since 1970]."""
    known = sorted(waits, key=lambda wait: list(SENTENCES).index(wait["what"]))
    return "; ".join(
        SENTENCES[wait["what"]].format(t=duration(now - wait["since"]))
        + (f" ({wait['detail']})" if wait["detail"] else "")
        for wait in known
    )


def duration(seconds: float) -> str:
    """Return a time of which only the size matters: in seconds up to two minutes, in minutes up to two hours."""
    seconds = max(seconds, 0.0)
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.0f} h"


def counted(number: int, noun: str) -> str:
    """Return a number of things: ``1 worker``, ``2 workers``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


class Waits:
    """What this process waits for at present."""

    def __init__(self) -> None:
        self._present: dict[str, Wait] = {}

    def begin(self, what: str, detail: object = "", for_s: float = 0.0) -> None:
        """Note that this is waited for, ``for_s`` seconds already; what was noted earlier keeps its beginning."""
        before = self._present.get(what, Wait(what, time.time() - for_s))
        self._present[what] = replace(before, detail=str(detail)[:LONGEST_DETAIL] or before.detail)

    def end(self, what: str) -> None:
        """Note that this is not waited for any more."""
        self._present.pop(what, None)

    @contextmanager
    def during(self, what: str) -> Iterator[None]:
        """Wait for this during a block."""
        self.begin(what)
        try:
            yield
        finally:
            self.end(what)

    def __iter__(self) -> Iterator[Wait]:
        return iter(list(self._present.values()))
