"""The watcher: the one reader of the store for all users, what they see of a campaign, and of all work in the store."""

import asyncio
import json
import logging
import math
import time
from collections.abc import AsyncGenerator, Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, TypeVar

from campaign.coordinator.heartbeat import Observation, observe
from campaign.coordinator.lease import HEARTBEAT_INTERVAL, LeaseHeld, SignOfLife, holder, judge_life
from campaign.coordinator.requests import finish_deletion, unfinished_deletions
from campaign.errors import CampaignError
from campaign.store import Store
from campaign.store.layout import HEARTBEAT, LEASE, SERVICE
from campaign.store.store import change_token, change_tokens
from clearcap.web.index import CampaignEntry, CampaignIndex
from reporting.capability.intervals import cpk_interval

CONFIDENCE = 0.95
PRELIMINARY = "these intervals assume normal, independent values; the report checks that"
LOOK_EVERY = 1.0  # s between two looks at the followed campaigns
LIST_EVERY = 5.0  # s between two looks at the change tokens of all campaigns
KEEP_ALIVE = 15.0  # s without news after which a stream sends a comment, so that proxies keep it open
COMMENT = b": still here\n\n"
RETRY = b"retry: 2000\n\n"  # ms after which a browser reconnects
T = TypeVar("T")
logger = logging.getLogger(__name__)


class Feed:
    """The latest snapshot of a campaign, for any number of followers; see `progress_of` for ``is_served``."""

    def __init__(self, *, is_served: bool) -> None:
        self._is_served = is_served
        self.latest: Snapshot | None = None
        self.seen: Observation | None = None
        self.followers = 0
        self._news = asyncio.Event()

    def publish(self, seen: Observation) -> None:
        """Pass a new observation to the followers, unless it shows nothing new."""
        if self.latest is not None and seen == self.seen:
            self.seen = seen  # it has the newer signs of life of the coordinator
            return
        self.seen, self.latest = seen, snapshot(seen, is_served=self._is_served)
        self.wake()

    def wake(self) -> None:
        """Wake all followers, so that they check for news."""
        self._news.set()
        self._news = asyncio.Event()

    async def news(self, seconds: float) -> None:
        """Wait until the followers are woken, for at most `seconds` [s]."""
        try:
            async with asyncio.timeout(seconds):
                await self._news.wait()
        except TimeoutError:
            pass


class Watcher:
    """Watch the store, keep the index up to date, and tell followers about changes; see `progress_of`."""

    def __init__(self, store: Store, index: CampaignIndex, *, is_served: bool = False) -> None:
        self._store, self.index, self.is_served = store.hasty, index, is_served
        self.listed_at: float | None = None  # time when the index was last updated, by the monotonic clock [s]
        self._listed_whole_at = -math.inf
        self._changed = set[str]()  # campaigns that this server has changed since the last look at them
        self._hurries = 0  # number of calls of `hurry`
        self.fault = ""  # why the store cannot be read
        self._feeds: dict[str, Feed] = {}
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="store-reader")
        self._wake = asyncio.Event()
        self._is_ending = False

    async def run(self) -> None:
        """Look at the store repeatedly until cancelled; when this returns, no thread reads the store any more."""
        self._loop = asyncio.get_running_loop()
        try:
            while True:
                await self._look()
                pause = 0.0 if self.index.is_behind and not self.fault else LOOK_EVERY
                try:
                    async with asyncio.timeout(pause):
                        await self._wake.wait()
                except TimeoutError:
                    pass
                self._wake.clear()
        finally:
            # wait for the look in progress, because the index that it writes to is closed next
            await asyncio.to_thread(self._reader.shutdown, cancel_futures=True)

    async def _look(self) -> None:
        """Look at the store once; if it cannot be read, note the fault and leave it to the next look."""
        try:
            if self.listed_at is None or (self._is_whole_due() and not self.index.is_behind):
                await self.list_campaigns()
            elif self.index.is_behind:
                await self._in_reader(self.index.read_some, self._store)
            for campaign, feed in list(self._feeds.items()):
                if feed.followers:
                    feed.publish(await self._in_reader(observe, self._store, campaign, feed.seen))
                else:
                    del self._feeds[campaign]
            self.fault = ""
        except CampaignError as error:
            if self.fault != str(error):
                logger.warning("%s", error)
            self.fault = str(error)
        except Exception:  # a bug in one look must not end all later ones
            logger.exception("the store could not be looked at")

    async def list_campaigns(self, changed: str | None = None) -> None:
        """Update the index now with the campaigns that this server has changed, and every five seconds with all.

        If many have changed, only the first ones are read; `run` goes on.
        """
        campaigns, hurries = {*self._changed, *([changed] if changed else [])}, self._hurries
        is_whole = not campaigns or self._is_whole_due()
        await self._in_reader(self._refresh, campaigns, is_whole)
        if hurries != self._hurries:
            return  # the store has changed since this look began; the next look is soon
        self._changed.clear()
        self.listed_at = time.monotonic()
        if is_whole:
            self._listed_whole_at = self.listed_at

    async def list_first(self) -> None:
        """Update the index unless it is up to date, as after this server has changed a campaign."""
        if self.listed_at is None:
            await self.list_campaigns()

    async def list_all(self) -> None:
        """Update the index now with all campaigns of the store."""
        await self.list_campaigns()
        while self.index.is_behind:
            await self._in_reader(self.index.read_some, self._store)

    def _is_whole_due(self) -> bool:
        """Return whether a look at all campaigns of the store is due."""
        return time.monotonic() - self._listed_whole_at >= LIST_EVERY

    def _refresh(self, changed: set[str], is_whole: bool) -> None:
        """Read the campaigns that this server has changed; then, if `is_whole`, some of the other changed ones."""
        if is_whole:
            for campaign in unfinished_deletions(self._store):
                with suppress(LeaseHeld):  # another process is still deleting it
                    finish_deletion(self._store, campaign)
            self.index.look(change_tokens(self._store))
        for campaign in changed:
            self.index.refresh_one(self._store, campaign, change_token(self._store, campaign))
        if is_whole:
            self.index.read_some(self._store)

    async def _in_reader(self, function: Callable[..., T], *arguments: object) -> T:
        """Call a function in the single thread that reads the store."""
        return await asyncio.get_running_loop().run_in_executor(self._reader, function, *arguments)

    def hurry(self, campaign: str | None = None) -> None:
        """Request an early look, because one campaign, or with None any of them, has just changed; thread-safe."""
        if campaign is None:
            self._listed_whole_at = -math.inf
        else:
            self._changed.add(campaign)
        self._hurries += 1
        self.listed_at = None
        with suppress(RuntimeError):  # the loop is closed, so there are no readers any more
            self._loop.call_soon_threadsafe(self._wake.set)

    def end_streams(self) -> None:
        """End the streams of all followers, because the server ends; they reconnect to the next server."""
        self._is_ending = True
        for feed in self._feeds.values():
            feed.wake()

    @property
    def followers(self) -> int:
        """Number of open streams."""
        return sum(feed.followers for feed in self._feeds.values())

    async def follow(self, campaign: str, last: str = "") -> AsyncGenerator[bytes]:
        """Yield the events of a campaign after that with the id `last`, until nothing more happens, or the end."""
        feed = self._feeds.setdefault(campaign, Feed(is_served=self.is_served))
        feed.followers += 1
        try:
            yield RETRY
            if feed.latest is None:
                feed.publish(await self._in_reader(observe, self._store, campaign, None))
            while not self._is_ending:
                latest = feed.latest
                assert latest is not None
                if latest.id != last:
                    last = latest.id
                    yield latest.event
                if latest.is_over:
                    yield b"event: end\ndata: {}\n\n"
                    return
                await feed.news(KEEP_ALIVE)
                if feed.latest is latest:
                    yield COMMENT
        finally:
            feed.followers -= 1


@dataclass(frozen=True)
class Snapshot:
    """The progress of a campaign at one moment."""

    state: str  # see `Observation`
    is_over: bool  # nothing more happens unless somebody requests it
    data: str  # the whole progress as JSON on one line
    id: str  # digest of the data; a follower that reconnects sends it to say what it has seen

    @property
    def event(self) -> bytes:
        """The snapshot as a server-sent event."""
        return f"id: {self.id}\nevent: progress\ndata: {self.data}\n\n".encode()


def snapshot(seen: Observation, *, is_served: bool) -> Snapshot:
    """Return the snapshot that followers get of an observation; see `progress_of`."""
    progress = progress_of(seen, is_served=is_served)
    data = json.dumps(progress, allow_nan=False, separators=(",", ":"))
    return Snapshot(seen.state, progress["over"], data, sha256(data.encode()).hexdigest()[:16])


def progress_of(seen: Observation, *, is_served: bool) -> dict[str, Any]:
    """Return the progress that an observation shows, as plain data; counts are None before the first heartbeat.

    With a coordinator kept alive (`is_served`) interrupted campaigns go on, and reports are still written.
    """
    beat = seen.heartbeat
    document: dict[str, Any] = {"campaign": seen.campaign, "state": seen.state, "message": seen.message}
    document |= {"since": seen.since, "over": seen.is_over and not (is_served and seen.is_open), "odd": seen.odd}
    counts = ("samples", "done", "ok", "failed", "left", "statuses", "rate", "eta_s", "workers", "repeats", "repeated")
    document |= {name: None if beat is None else getattr(beat, name) for name in counts}
    document |= {"waiting": beat.waiting if beat else [], "waits_for": beat.waits_for if beat else ""}
    document["time"] = (
        beat.time if beat and beat.waiting else None
    )  # by which the beginnings of what it waits for count
    responses = {} if beat is None else beat.responses
    document["responses"] = {
        name: response | {"cpk_interval": preliminary_interval(response)} for name, response in responses.items()
    }
    return document | {"interval": PRELIMINARY}


def preliminary_interval(response: Mapping[str, float | None]) -> tuple[float, float] | None:
    """Return the interval of a Cpk; None if there is no Cpk or there are fewer than three values."""
    cpk, n = response["cpk"], response["n"]
    return None if cpk is None or not n or n < 3 else cpk_interval(cpk, int(n), CONFIDENCE)


UNSETTLED = ("queued", "running", "interrupted")  # states from which a campaign may continue


@dataclass(frozen=True)
class ServingProcess:
    """The process that coordinates the queued campaigns of a store."""

    pid: str
    machine: str
    seconds: float | None  # time that it has served, by its heartbeats; None before the first
    sign: SignOfLife  # whether the process is alive


@dataclass(frozen=True)
class UnsettledCampaign:
    """A campaign that runs or waits for a coordinator."""

    entry: CampaignEntry  # in the list of campaigns
    seen: Observation  # current state by its own files
    pid: str  # of the process on `machine` that coordinates it; both empty if there is none
    machine: str


@dataclass(frozen=True)
class Workload:
    """The running and waiting campaigns of a store, and the process that serves it."""

    serving: ServingProcess | None  # None if there is none, or it has shut down properly
    running: list[UnsettledCampaign]
    waiting: list[UnsettledCampaign]  # in the order in which the serving process takes them

    @property
    def workers(self) -> int:
        """Number of workers of all running campaigns."""
        return sum(each.seen.heartbeat.workers for each in self.running if each.seen.heartbeat)


def look_at_work(store: Store, entries: Iterable[CampaignEntry], earlier: Workload | None = None) -> Workload:
    """Return the current workload of a store that does not wait (`Store.hasty`); the files are read once.

    `earlier` is the result of the previous look: two are needed to tell whether a process on another machine is alive.
    """
    before = {} if earlier is None else {each.entry.campaign: each.seen for each in earlier.running}
    found = []
    for entry in sorted(entries, key=lambda each: each.campaign):
        if entry.state in UNSETTLED:
            seen, lease = observe(store, entry.campaign, before.get(entry.campaign)), None
            if seen.state == "running":
                lease = store.read_json(entry.campaign, LEASE)
            found.append(UnsettledCampaign(entry, seen, *holder(lease)))
    return Workload(
        serving=_serving(store, earlier.serving if earlier else None),
        running=[each for each in found if each.seen.state == "running"],
        waiting=[each for each in found if each.seen.state != "running" and each.seen.is_open],
    )


def _serving(store: Store, earlier: ServingProcess | None) -> ServingProcess | None:
    """Return the process that serves the store; None if no process holds its lease."""
    lease, heartbeat = store.read_json(SERVICE, LEASE), store.read_json(SERVICE, HEARTBEAT)
    if lease is None:
        return None
    sign = judge_life(lease, heartbeat, earlier.sign if earlier else None, time.monotonic())
    beats = (heartbeat or {}).get("beat")
    seconds = beats * HEARTBEAT_INTERVAL if isinstance(beats, int) else None
    return ServingProcess(*holder(lease), seconds, sign)
