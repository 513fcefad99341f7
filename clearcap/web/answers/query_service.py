"""Answers to questions about campaigns, with the numbers of the command line; each is computed once and cached."""

import asyncio
import hashlib
import json
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

from campaign.errors import SpecError, StoreError
from campaign.row_build import clearcap_version
from campaign.store import Store
from campaign.store.layout import MANIFEST, PARTS, PLAN, STOPPED
from clearcap.web.answers.column_cache import USUAL_SIZE
from clearcap.web.answers.fair_queue import Busy
from clearcap.web.answers.job_pool import JobPool
from clearcap.web.answers.queries import (
    AskedRows,
    advice_answer,
    allocation_answer,
    comparison_answer,
    histogram_answer,
    histograms_answer,
    samples_answer,
    what_if_answer,
)

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


KEPT_BYTES = 64 << 20  # size of all cached answers
MOST_SETTINGS, LONGEST_SETTING = 200, 1000  # settings in a question; characters in a setting
FRESH_FOR = 1.0  # s in which a campaign is not looked at again
LOOKING_SHARE = 0.05  # share of the time that looking at a campaign may take
_OF_A_QUESTION = 2.0  # the version of the rows is not checked again for this multiple of a question's computing time


@dataclass(frozen=True)
class Answer:
    """An answer as it is sent."""

    content: bytes  # JSON
    etag: str  # of the rows, the question and the version of the program; in quotes, as HTTP requires


@dataclass
class _Version:
    """The version of a campaign's rows, and the time until which it is not checked again."""

    name: str
    until: float


class QueryService:
    """Answer questions about the campaigns of a store, in one event loop.

    `folder` holds the cached columns, in files of at most `at_most` bytes together; see
    `clearcap.web.answers.column_cache.columns_folder`. Cached answers take at most `kept_bytes`.
    """

    def __init__(
        self, pool: JobPool, store: Store, folder: Path, at_most: int = USUAL_SIZE, kept_bytes: int = KEPT_BYTES
    ) -> None:
        self._pool, self._store, self._folder, self._at_most = pool, store, folder, at_most
        self._kept, self._flights = ResponseCache(kept_bytes), SingleFlight()
        self._versions: dict[str, _Version] = {}
        self._program = clearcap_version()

    async def what_if(self, user: str, campaign: str, settings: Sequence[str], *, preview: bool = False) -> Answer:
        """Return the document of ``clearcap whatif CAMPAIGN --set ... --json``, with the same numbers to the last bit.

        With `preview` only the first 100,000 samples are used. If there are more, the document has ``"preview":
        {"rows": 100000, "of": ...}``; without this key it is exact. Raises SpecError if a setting is not possible, or
        the samples are not drawn from distributions. Raises CampaignError if there are no samples. For others see
        `JobPool.run`.
        """
        return await self._ask(user, what_if_answer, [campaign], _checked(settings), preview)

    async def histogram(
        self, user: str, campaign: str, response: str, settings: Sequence[str] = (), *, preview: bool = False
    ) -> Answer:
        """Return the bins of a response before and after a change; see `queries.histogram_answer` and `what_if`."""
        checked = _checked(settings) if settings else ()
        return await self._ask(user, histogram_answer, [campaign], response, checked, preview)

    async def histograms(
        self, user: str, campaign: str, settings: Sequence[str] = (), *, preview: bool = False
    ) -> Answer:
        """Return the bins of all responses before and after a change; see `queries.histograms_answer`."""
        checked = _checked(settings) if settings else ()
        return await self._ask(user, histograms_answer, [campaign], checked, preview)

    async def advise(self, user: str, campaign: str) -> Answer:
        """Return the document of ``clearcap advise CAMPAIGN --json``; it raises the errors of `what_if`."""
        return await self._ask(user, advice_answer, [campaign])

    async def allocate(self, user: str, campaign: str, costs: str | Mapping[str, Any]) -> Answer:
        """Return the document of ``clearcap advise CAMPAIGN --cost FILE --json`` for a cost file's text or tables."""
        return await self._ask(user, allocation_answer, [campaign], costs)

    async def compare(self, user: str, campaign: str, other: str) -> Answer:
        """Return the comparison of two campaigns that is in ``capability.json`` of a report against the other one."""
        return await self._ask(user, comparison_answer, [campaign, other])

    async def samples(self, user: str, campaign: str, sort: str, status: str | None, cursor: int, count: int) -> Answer:
        """Return a page of the samples; see `clearcap.web.answers.queries.samples_answer`."""
        return await self._ask(user, samples_answer, [campaign], sort, status, cursor, count)

    async def version(self, campaign: str) -> str:
        """Return the version of a campaign's rows; raise StoreError if the store has no such campaign.

        It is looked up again after a second, or after twenty times the duration of the last look, if that is longer.
        After a question was computed, it is kept for at least twice the computing time.
        """
        known = self._versions.get(campaign)
        if known is None or known.until < monotonic():
            key = f"version of {campaign}"
            await self._flights.once(key, lambda: self._look(campaign))
            known = self._versions[campaign]
        return known.name

    async def _look(self, campaign: str) -> bytes:
        """Look up and cache the version of a campaign's rows."""
        begun = monotonic()
        name = await asyncio.to_thread(rows_version, self._store, campaign)
        now = monotonic()
        keep = max(FRESH_FOR, (now - begun) / LOOKING_SHARE)
        self._versions = {other: each for other, each in self._versions.items() if each.until > now}
        self._versions[campaign] = _Version(name, now + keep)
        return name.encode()

    async def _ask(self, user: str, question: Callable[..., Any], campaigns: Sequence[str], *rest: Any) -> Answer:
        """Return the answer to a question about some campaigns, from the cache or computed."""
        versions = [await self.version(campaign) for campaign in campaigns]
        asked = [self._program, self._store.url, question.__name__, *campaigns, *versions, *rest]
        key = hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()
        content = self._kept.get(key)
        if content is None:
            rows = [self._rows(*each) for each in zip(campaigns, versions, strict=True)]
            content = await self._flights.once(key, self._computing(key, user, question, rows, rest))
        return Answer(content, f'"{key[:32]}"')

    def _rows(self, campaign: str, version: str) -> AskedRows:
        """Return the description of a campaign's rows for a worker."""
        return AskedRows(self._store.files.full_url, campaign, version, str(self._folder), self._at_most)

    def _computing(
        self, key: str, user: str, question: Callable[..., Any], rows: list[AskedRows], rest: Sequence[Any]
    ) -> Callable[[], Coroutine[None, None, bytes]]:
        """Return a function that computes an answer and caches it."""

        async def compute() -> bytes:
            begun = monotonic()
            content = await self._pool.run(user, question, *rows, *rest)
            self._kept.put(key, content)
            # keep the version while rows arrive: otherwise each step of a slider would have to load new rows
            until = monotonic() + _OF_A_QUESTION * (monotonic() - begun)
            for asked in rows:
                known = self._versions.get(asked.campaign)
                if known is not None and known.name == asked.version:
                    known.until = max(known.until, until)
            return content

        return compute


def _checked(settings: Sequence[str]) -> tuple[str, ...]:
    """Return settings after checking that there are some, not too many, and none too long."""
    if not settings:
        raise SpecError("no --set is given, so no distribution changes; write for example --set J1.std=0.01")
    if len(settings) > MOST_SETTINGS or any(len(setting) > LONGEST_SETTING for setting in settings):
        raise SpecError(
            f"--set: {len(settings)} settings, the longest of {max(map(len, settings))} characters; allowed: up to"
            f" {MOST_SETTINGS} of up to {LONGEST_SETTING}"
        )
    return tuple(settings)


def rows_version(store: Store, campaign: str) -> str:
    """Return a digest of all that determines the rows of a campaign: its plan, manifest, files of rows, and end.

    The manifest lists each file with its size and digest. Files that it does not list yet are identified by name and
    size, as in a survey. Merging files changes the version, although the rows stay the same.
    """
    digest = hashlib.sha256()
    for name in (PLAN, MANIFEST, STOPPED):
        try:
            content = store.files.read(f"{campaign}/{name}")
        except FileNotFoundError:
            if name == PLAN:
                raise StoreError(
                    f"store {store.url}: has no campaign {campaign}; see: {store.command('list')}"
                ) from None
            content = b""
        digest.update(hashlib.sha256(content).digest())
    for name, size in sorted(store.files.sizes(f"{campaign}/{PARTS}").items()):
        digest.update(f"{name} {size}\n".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()
