"""Questions about the samples of a campaign: as a job answers them, and as the server asks and keeps them.

A process keeps the plans and mapped columns of the campaigns that were used last, so that a question takes only as
long as its arithmetic; the server computes each answer once, with the numbers of the command line.
"""

import asyncio
import hashlib
import json
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from time import monotonic
from typing import Any

from campaign.errors import SpecError, StoreError
from campaign.plan import Plan
from campaign.plan_header import PARTS
from campaign.samples import SampleColumns
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from campaign.store.files.several import content, read_several
from campaign.store.layout import PLAN, STOPPED, is_of_manifest
from clearcap.questions.samples import list_samples, sample_cloud
from clearcap.questions.tolerances import (
    advice_document,
    allocation_document,
    cheapest_from,
    read_cost_text,
)
from clearcap.questions.whatif import histograms, what_if_document, what_if_from
from clearcap.web.jobs.column_cache import ColumnCache
from clearcap.web.jobs.pool import Busy, JobPool

PREVIEW_ROWS = 100_000  # these rows give the Cpk of a million rows to within 0.001
MOST_SETTINGS, LONGEST_SETTING = 200, 1000  # settings in a question; characters in a setting
KEPT_CAMPAIGNS = 8  # plans and mapped columns that a worker keeps


@dataclass(frozen=True)
class AskedRows:
    """The rows that a question is about."""

    store: str  # path or URL, including what is needed for access
    campaign: str
    version: str  # see `rows_version`
    folder: str  # of the cache of columns


@lru_cache(maxsize=KEPT_CAMPAIGNS)
def _opened(rows: AskedRows) -> tuple[str, Plan, SampleColumns]:
    """Return the URL of a store, a campaign's plan and columns; each version of its rows has its own cache entry."""
    store = open_store(rows.store, QUICK)
    plan = store.plan(rows.campaign)
    return store.url, plan, ColumnCache(Path(rows.folder)).columns(store, plan, rows.version)


def _opened_rows(
    rows: AskedRows, settings: Sequence[str], preview: bool
) -> tuple[str, Plan, SampleColumns, dict[str, Any]]:
    """Return what is `_opened`, and an entry ``preview`` of the document if that leaves samples out, else none."""
    if len(settings) > MOST_SETTINGS or any(len(setting) > LONGEST_SETTING for setting in settings):
        raise SpecError(
            f"--set: {len(settings)} settings, the longest of {max(map(len, settings))} characters; allowed: up to"
            f" {MOST_SETTINGS} of up to {LONGEST_SETTING}"
        )
    url, plan, columns = _opened(rows)
    total = columns.number.size
    if not preview or total <= PREVIEW_ROWS:
        return url, plan, columns, {}
    return url, plan, columns.first(PREVIEW_ROWS), {"preview": {"rows": PREVIEW_ROWS, "of": total}}


def what_if_answer(rows: AskedRows, settings: Sequence[str], preview: bool) -> dict[str, Any]:
    """Return the document of ``clearcap whatif --json``; without ``preview`` in it, it is of all samples."""
    if not settings:
        raise SpecError("no --set is given, so no distribution changes; write for example --set J1.std=0.01")
    url, plan, columns, mark = _opened_rows(rows, settings, preview)
    answers = what_if_from(plan, columns, settings, emulates=not preview)  # a slider asks many times a second
    return what_if_document(plan, url, settings, answers) | mark


def histogram_answer(rows: AskedRows, response: str, settings: Sequence[str], preview: bool) -> dict[str, Any]:
    """Return ``campaign``, ``set`` and the `Bins` of a response."""
    _, plan, columns, mark = _opened_rows(rows, settings, preview)
    (bins,) = histograms(plan, columns, settings, [response])
    return {"campaign": plan.campaign_id, "set": list(settings), **bins.model_dump()} | mark


def histograms_answer(rows: AskedRows, settings: Sequence[str], preview: bool) -> dict[str, Any]:
    """Return ``campaign``, ``set`` and ``histograms``, the `Bins` of each response."""
    _, plan, columns, mark = _opened_rows(rows, settings, preview)
    bins = histograms(plan, columns, settings, plan.mechanism.responses)
    found = {"histograms": [each.model_dump() for each in bins]}
    return {"campaign": plan.campaign_id, "set": list(settings), **found} | mark


def advice_answer(rows: AskedRows) -> dict[str, Any]:
    """Return the document of ``clearcap advise --json``."""
    from clearcap.questions.report import advice_of  # loads packages that only reports need

    store = open_store(rows.store, QUICK)
    plan = store.plan(rows.campaign)
    return advice_document(plan, store.url, advice_of(store, plan))


def allocation_answer(rows: AskedRows, costs: str) -> dict[str, Any]:
    """Return the document of ``clearcap advise --cost FILE --json`` for the text of a cost file."""
    url, plan, columns = _opened(rows)
    return allocation_document(plan, url, cheapest_from(plan, columns, read_cost_text(costs, plan)))


def comparison_answer(rows: AskedRows, other: AskedRows) -> dict[str, Any]:
    """Return the comparison of two campaigns; see `clearcap.questions.report`."""
    from clearcap.questions.report import comparison_document  # loads packages that only reports need

    if rows.campaign == other.campaign:
        raise SpecError(f"{other.campaign}: is the campaign itself; name another one to compare with")
    store = open_store(rows.store, QUICK)
    return comparison_document(store, store.plan(rows.campaign), store.plan(other.campaign))


def samples_answer(
    rows: AskedRows, sort: str, status: str | None, cursor: int, count: int, ranges: Sequence[str]
) -> dict[str, Any]:
    """Return a page of the samples."""
    store = open_store(rows.store, QUICK)
    return list_samples(store, store.plan(rows.campaign), sort, status, cursor, count, ranges).model_dump()


def cloud_answer(rows: AskedRows, ranges: Sequence[str]) -> dict[str, Any]:
    """Return the samples within ranges for a drawing; see `clearcap.questions.samples.sample_cloud`."""
    _, plan, columns = _opened(rows)
    return sample_cloud(plan, columns, ranges)


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
        """Return what ``compute``, or an equal one in progress, gives; Busy only if this call's own is refused."""
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


KEPT_BYTES = 128 << 20  # size of all cached answers, such as pictures
FRESH_FOR = 1.0  # s in which a campaign is not looked at again
LOOKING_SHARE = 0.05  # share of the time that looking at a campaign may take
_OF_A_QUESTION = 2.0  # the version of the rows is not checked again for this multiple of a question's computing time


@dataclass
class _Version:
    """The version of a campaign's rows, and the time until which it is not checked again."""

    name: str
    until: float


class QueryService:
    """Answer questions about the campaigns of a store, in one event loop, each once; errors are of `JobPool.run`."""

    def __init__(self, pool: JobPool, store: Store, folder: Path) -> None:
        self._pool, self._store, self._folder = pool, store, folder
        self._kept, self._flights = ResponseCache(KEPT_BYTES), SingleFlight()
        self._versions: dict[str, _Version] = {}

    async def ask(self, user: str, question: Callable[..., Any], campaigns: Sequence[str], *rest: Any) -> bytes:
        """Return the answer to one of the questions above about some campaigns, from the cache or computed."""
        versions = [await self.version(campaign) for campaign in campaigns]
        key = hashlib.sha256(json.dumps([question.__name__, *campaigns, *versions, *rest]).encode()).hexdigest()
        address, folder = self._store.files.full_url, str(self._folder)
        rows = [AskedRows(address, *each, folder) for each in zip(campaigns, versions, strict=True)]

        async def compute() -> bytes:
            begun = monotonic()
            content = await self._pool.run(user, question, *rows, *rest)
            # keep the version while rows arrive: otherwise each step of a slider would have to load new rows
            until = monotonic() + _OF_A_QUESTION * (monotonic() - begun)
            for asked in rows:
                known = self._versions.get(asked.campaign)
                if known is not None and known.name == asked.version:
                    known.until = max(known.until, until)
            return content

        return await self._computed_once(key, compute)

    async def made(self, user: str, job: Callable[..., Any], *arguments: object) -> bytes:
        """Return the result of a job that depends on its arguments alone; those with equal ``repr`` are the same."""
        key = hashlib.sha256(repr((job.__module__, job.__name__, arguments)).encode(errors="surrogatepass")).hexdigest()
        return await self._computed_once(key, lambda: self._pool.run(user, job, *arguments))

    async def version(self, campaign: str) -> str:
        """Return the `rows_version` of a campaign, looked up again after a second or more; see `LOOKING_SHARE`."""
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

    async def _computed_once(self, key: str, compute: Callable[[], Coroutine[None, None, bytes]]) -> bytes:
        """Return a kept answer, or compute and keep it, once for all who ask meanwhile."""
        content = self._kept.get(key)
        if content is None:
            content = await self._flights.once(key, compute)
            self._kept.put(key, content)
        return content


def rows_version(store: Store, campaign: str) -> str:
    """Return a digest of all that determines the rows of a campaign: its plan, manifest, files of rows, and end.

    Files that the manifest does not list yet count by name and size. Merging files changes it, although no row does.
    """
    digest = hashlib.sha256()
    documents = (PLAN, STOPPED, *sorted(filter(is_of_manifest, store.files.names(campaign))))
    for path, tried in read_several(store.files, [f"{campaign}/{name}" for name in documents], content):
        found = content(store.files, path) if tried is None else tried
        if not found and path.endswith(PLAN):
            raise StoreError(f"store {store.url}: has no campaign {campaign}; see: {store.command('list')}")
        digest.update(path.encode() + hashlib.sha256(found).digest())
    for name, size in sorted(store.files.sizes(f"{campaign}/{PARTS}").items()):
        digest.update(f"{name} {size}\n".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()
