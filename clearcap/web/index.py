"""What a server knows of the campaigns of its store, read again only when their files have changed.

The list entry of each, with the conclusions of its report, is in a file that may be deleted at any time, because it is
built again from the store; the counted rows are kept in memory.
"""

import logging
import sqlite3
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from typing import Any

from pydantic import BaseModel, Field, ValidationError

from campaign.coordinator.heartbeat import Observation, observe
from campaign.coordinator.progress_report import progress_report, running_report
from campaign.coordinator.state import STATES
from campaign.errors import CampaignError, unwritable
from campaign.store import Store
from campaign.store.labels import read_labels
from campaign.store.layout import REPORT, SUBMISSION
from campaign.store.monitored_library import Fall, read_monitored
from campaign.store.store import change_token
from reporting.capability.verdict import WORST_FIRST

Interval = tuple[float, float]
logger = logging.getLogger(__name__)
REPORT_DOCUMENT = f"{REPORT}/capability.json"
# Campaigns with too few ok samples have no verdict on any response, which is worse than any.
_WORST_FIRST = ("no verdict", *WORST_FIRST[:-1], "constant", "capable")
LISTED_STATES = (*STATES, "incomplete", "planned", "broken")


class Weakest(BaseModel):
    """The response with the smallest index, which is that of its verdict once there is a report, until then Cpk."""

    response: str = Field(examples=["FC-1"])
    cpk: float = Field(examples=[1.21])
    interval: Interval | None = Field(None, examples=[(1.18, 1.24)])


class BelowTarget(BaseModel):
    """A response whose index is below the target with its whole interval."""

    response: str = Field(examples=["FC-1"])
    cpk: float = Field(examples=[1.21])
    interval: Interval = Field(examples=[(1.18, 1.24)])
    target: float = Field(examples=[1.33])


class _Spec(BaseModel):
    name: str
    requirement: float | None = None


class _Capability(BaseModel):
    cpk: float | None
    cpk_interval: tuple[float | None, float | None] | None

    @property
    def interval(self) -> Interval | None:
        """The interval of Cpk; None if it lacks an end."""
        low, high = self.cpk_interval or (None, None)
        return None if low is None or high is None else (low, high)


class _Response(BaseModel):
    spec: _Spec
    capability: _Capability
    index: float | None = None  # that decides; absent from reports of earlier versions, which have Cpk
    index_low: float | None = None
    index_high: float | None = None
    verdict: str = "no limits"
    certain: bool | None = None

    @property
    def decides(self) -> tuple[float | None, Interval | None]:
        """The index that decides, and its interval; None if it lacks an end."""
        if self.index is None:
            return self.capability.cpk, self.capability.interval
        if self.index_low is None or self.index_high is None:
            return self.index, None
        return self.index, (self.index_low, self.index_high)


class _Yield(BaseModel):
    share: float


class _ProductYield(BaseModel):
    with_failures: _Yield | None
    counted: _Yield


class _Thresholds(BaseModel):
    capable: float


class Conclusions(BaseModel):
    """The conclusions of a report, read from its ``capability.json``."""

    headline: str
    responses: list[_Response]
    product: _ProductYield | None
    thresholds: _Thresholds

    @property
    def weakest(self) -> Weakest | None:
        """The response with the smallest index; None if no response has one."""
        return weakest_of({r.spec.name: r.decides for r in self.responses})

    @property
    def below_target(self) -> list[BelowTarget]:
        """The responses whose index is below the target with its whole interval."""
        usual = self.thresholds.capable
        known = [(r.spec.name, *r.decides, r.spec.requirement or usual) for r in self.responses]
        return [
            BelowTarget(response=name, cpk=index, interval=interval, target=target)
            for name, index, interval, target in known
            if index is not None and interval is not None and interval[1] < target
        ]

    @property
    def verdict(self) -> str:
        """The worst verdict, such as "not capable" or "capable, not certain"; empty without a response with limits."""
        words = [r.verdict + ("" if r.certain is not False else ", not certain") for r in self.responses]
        known = [word for word in words if word in _WORST_FIRST]
        return min(known, key=_WORST_FIRST.index, default="")

    @property
    def share_ok(self) -> float | None:
        """Share of the product within all limits; failed runs count as outside if the report has that share."""
        return None if self.product is None else (self.product.with_failures or self.product.counted).share


def weakest_of(indices: Mapping[str, tuple[float | None, Interval | None]]) -> Weakest | None:
    """Return the response with the smallest Cpk of those given with their intervals; None if no response has a Cpk."""
    known = [(cpk, name, interval) for name, (cpk, interval) in indices.items() if cpk is not None]
    if not known:
        return None
    cpk, name, interval = min(known, key=lambda each: each[0])
    return Weakest(response=name, cpk=cpk, interval=interval)


class CampaignEntry(BaseModel):
    """The entry of a campaign in the list of campaigns."""

    campaign: str = Field(description="Id of the campaign", examples=["c60-0a1b2c3d4e"])
    title: str = Field("", examples=["Schneider C-60"])
    state: str = Field(description=f"{', '.join(LISTED_STATES[:-1])} or {LISTED_STATES[-1]}", examples=["completed"])
    message: str = Field("", description="Details of the state, or what is wrong with a broken campaign")
    since: datetime | None = Field(None, description="When the state began")
    samples: int | None = Field(None, description="Rows that are planned", examples=[30850])
    done: int | None = Field(None, description="Rows that are stored", examples=[30850])
    ok: int | None = Field(None, description="Rows with status ok", examples=[30850])
    failed: int | None = Field(None, description="Rows with another status", examples=[0])
    left: int | None = Field(None, description="Rows that are to be computed", examples=[0])
    share_ok: float | None = Field(None, description="Share of the product within all limits", examples=[0.9987])
    weakest: Weakest | None = Field(None, description="Smallest Cpk of the report, or of the rows so far")
    below_target: list[BelowTarget] = Field([], description="Of the report: the Cpk's upper end is below 1.33")
    monitored: int | None = Field(None, description="Number of the measured parts that were looked at last")
    falls: list[Fall] = Field([], description="Responses whose index fell below its requirement with measured parts")
    headline: str = Field("", description="What the report concludes")
    verdict: str = Field(
        "", description="The worst verdict of the report; empty without one", examples=["capable, not certain"]
    )
    has_report: bool = Field(False, description="A report is written")
    decided_by: list[str] = Field(
        [], description="Campaigns whose runs aim at rejects and decide this one", examples=[["c60-rare-4b5c6d7e8f"]]
    )
    submitted_by: str = ""
    submitted_at: datetime | None = None
    owner: str = Field("", examples=["eva"])
    tags: list[str] = Field(default=[], examples=[["c60", "release-3"]])
    note: str = ""
    archived: bool = False
    labels_version: int = Field(0, description="Send it back with a change, so that no other change is lost")


def entry_of(store: Store, campaign_id: str) -> CampaignEntry:
    """Read the list entry of a campaign; the entry of a broken campaign says what is wrong with it."""
    try:
        return _entry(Store(store.files.listed(campaign_id)), campaign_id)
    except CampaignError as error:
        return CampaignEntry(campaign=campaign_id, state="broken", message=str(error))
    except Exception as error:  # a fault in one campaign must not hide the others
        logger.exception("campaign %s cannot be listed", campaign_id)
        message = f"it cannot be listed, because of a bug in clearcap: {error!r:.200}"
        return CampaignEntry(campaign=campaign_id, state="broken", message=message)


def _entry(store: Store, campaign_id: str) -> CampaignEntry:
    """Return the entry of a campaign; raise CampaignError if the campaign is broken."""
    header, seen = store.plan_header(campaign_id), observe(store, campaign_id)
    labels = read_labels(store, campaign_id)
    entry = CampaignEntry(
        campaign=campaign_id, title=header.title, state=seen.state, message=seen.message, since=_date(seen.since)
    )
    submission = store.read_json(campaign_id, SUBMISSION) or {}
    entry.submitted_by, entry.submitted_at = str(submission.get("user", ""))[:200], _date(submission.get("time"))
    entry.owner, entry.tags, entry.note = labels.owner, list(labels.tags), labels.note
    entry.archived, entry.labels_version = labels.archived, labels.version
    entry.decided_by = store.decided_by([campaign_id])
    if seen.state == "running" and seen.heartbeat is not None:
        # a running campaign is read at each look, so its counts are those of the heartbeat and not of a survey of all
        # files
        beat = seen.heartbeat
        entry.samples, entry.done, entry.ok = beat.samples, beat.done, beat.ok
        entry.failed, entry.left = beat.failed, beat.left
        entry.weakest = weakest_of({name: (r["cpk"], None) for name, r in beat.responses.items()})
        return entry
    survey, entry.samples = store.survey(header), store.end(header)
    entry.done, entry.ok = survey.rows, survey.statuses.get("ok", 0)
    entry.failed, entry.left = header.failed(survey.statuses), entry.samples - entry.done
    if entry.state == "completed" and entry.left:
        entry.state, entry.message = "incomplete", f"rows lost after the campaign was completed: {entry.left}"
    if (seen_last := read_monitored(store, campaign_id)) is not None:
        entry.monitored, entry.falls = seen_last.number, seen_last.falls
    with suppress(FileNotFoundError):  # there is no report
        _add_report(entry, store.files.read(f"{campaign_id}/{REPORT_DOCUMENT}"))
    return entry


def _add_report(entry: CampaignEntry, report: bytes) -> None:
    """Add the conclusions of a report to an entry, or a message if the report cannot be read."""
    entry.has_report = True
    try:
        concluded = Conclusions.model_validate_json(report)
    except ValidationError:
        entry.message = entry.message or "the report was written by another version, or damaged; write it again"
        return
    entry.headline, entry.share_ok = concluded.headline, concluded.share_ok
    entry.weakest, entry.below_target = concluded.weakest, concluded.below_target
    entry.verdict = concluded.verdict


def _date(seconds: Any) -> datetime | None:
    """Return a time [s since 1970] as a date; None if it is not a valid time."""
    is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    return datetime.fromtimestamp(seconds, UTC) if is_number and 0.0 < seconds < 3e10 else None


FORMAT = 3
READERS = 4  # campaigns that are read at the same time
MOVING = ("queued", "running")  # states in which a campaign is read at each look
AT_ONCE = 50  # campaigns that are read between two writes


class CampaignIndex:
    """The index of a store, in a file; raise CampaignError if the file can be neither read nor created."""

    def __init__(self, path: Path) -> None:
        self._lock, self._is_closed = threading.Lock(), False
        self._entries: dict[str, tuple[str, CampaignEntry, bytes]] = {}  # change token, entry, and the entry as JSON
        self._stale: dict[str, str] = {}  # change tokens of campaigns that are to be read
        self._connection = _opened(path)
        for campaign, token, text in self._connection.execute("SELECT campaign, token, entry FROM entries").fetchall():
            try:
                self._entries[campaign] = token, CampaignEntry.model_validate_json(text), text.encode()
            except ValidationError:  # written by another version; read again from the store
                continue

    def look(self, tokens: Mapping[str, str]) -> None:
        """Drop the campaigns that are gone, and find those that must be read again because they have changed.

        Queued and running ones always are: neither progress nor the death of a coordinator changes a token.
        """
        gone = set(self._entries) - set(tokens)
        with self._lock:
            for campaign in gone:
                self._entries.pop(campaign, None)
            self._keep("DELETE FROM entries WHERE campaign = ?", [(campaign,) for campaign in gone])
            self._stale = {campaign: t for campaign, t in tokens.items() if not self._is_fresh(campaign, t)}

    def read_some(self, store: Store) -> None:
        """Read some of the changed campaigns, beginning with those that have no entry yet."""
        with self._lock:
            order = sorted(self._stale, key=self._entries.__contains__)[:AT_ONCE]
            some = {campaign: self._stale[campaign] for campaign in order}
        self._read(store, some)

    @property
    def is_behind(self) -> bool:
        """Whether there are changed campaigns that have not been read yet."""
        return bool(self._stale)

    @property
    def unread(self) -> int:
        """Number of campaigns that have no entry yet."""
        with self._lock:
            return len(self._stale.keys() - self._entries.keys())

    def refresh_one(self, store: Store, campaign: str, token: str | None) -> None:
        """Read one campaign again if it has changed; drop it if its token is None, which means that it is gone."""
        if token is None:
            self.forget(campaign)
        elif not self._is_fresh(campaign, token):
            self._read(store, {campaign: token})

    def forget(self, campaign: str) -> None:
        """Drop a campaign that this server has deleted, before the next look at the store."""
        with self._lock:
            self._entries.pop(campaign, None)
            self._stale.pop(campaign, None)
            self._keep("DELETE FROM entries WHERE campaign = ?", [(campaign,)])

    def _is_fresh(self, campaign: str, token: str) -> bool:
        known = self._entries.get(campaign)
        return known is not None and known[0] == token and known[1].state not in MOVING

    def _read(self, store: Store, tokens: Mapping[str, str]) -> None:
        """Read some campaigns and keep their entries; a campaign that cannot be read waits for the next look."""
        with self._lock:
            for campaign in tokens:
                self._stale.pop(campaign, None)
        with ThreadPoolExecutor(READERS) as readers:
            entries = list(readers.map(lambda campaign: entry_of(store, campaign), tokens))
        texts = [entry.model_dump_json() for entry in entries]
        with self._lock:
            for (campaign, token), entry, text in zip(tokens.items(), entries, texts, strict=True):
                self._entries[campaign] = token, entry, text.encode()
            rows = [(campaign, token, text) for (campaign, token), text in zip(tokens.items(), texts, strict=True)]
            self._keep("INSERT OR REPLACE INTO entries VALUES (?, ?, ?)", rows)

    def _keep(self, statement: str, rows: Sequence[tuple[str, ...]]) -> None:
        """Change the file, unless it is closed or the disk is full; the next server reads those campaigns again."""
        if self._is_closed:
            return
        try:
            self._connection.executemany(statement, rows)
            self._connection.commit()
        except sqlite3.OperationalError:
            self._connection.rollback()

    def entries(self) -> Iterator[tuple[CampaignEntry, bytes]]:
        """Yield the entry of each campaign, as an object and as JSON."""
        with self._lock:
            known = list(self._entries.values())
        for _, entry, text in known:
            yield entry, text

    def entry(self, campaign: str) -> CampaignEntry | None:
        """Return the entry of a campaign; None if it has none."""
        with self._lock:
            known = self._entries.get(campaign)
        return known[1] if known else None

    def close(self) -> None:
        """Close the file while no thread is writing to it, because SQLite would then use freed memory."""
        with self._lock:
            self._is_closed = True
            self._connection.close()


def _opened(path: Path) -> sqlite3.Connection:
    """Open the file of the index; replace it if it is damaged or has another format."""
    for _ in range(2):
        try:
            path.touch()
            connection = sqlite3.connect(path, check_same_thread=False)
        except (OSError, sqlite3.OperationalError) as error:
            raise _unusable(path, error) from error
        try:
            connection.execute("PRAGMA synchronous = OFF")  # a file damaged by a power failure is built again
            if connection.execute("PRAGMA user_version").fetchone()[0] == FORMAT:
                connection.execute("SELECT campaign, token, entry FROM entries LIMIT 1").fetchone()
                return connection
            connection.execute("DROP TABLE IF EXISTS entries")
            connection.execute("CREATE TABLE entries (campaign TEXT PRIMARY KEY, token TEXT, entry TEXT) STRICT")
            connection.execute(f"PRAGMA user_version = {FORMAT}")
            connection.commit()
            return connection
        except sqlite3.DatabaseError:
            connection.close()
            path.unlink(missing_ok=True)
    raise _unusable(path)


def _unusable(path: Path, error: Exception | None = None) -> CampaignError:
    """Return the error for an index that can be neither read nor created."""
    why = f" ({error})" if error else ""
    return unwritable(
        f"{path}: this index of the campaigns can be neither read nor made{why}; remove it and see that its disk can be"
        " written, then start the server again",
        error,
    )


MOST_KEPT = 2000  # campaigns
RECOUNT_AFTER = 60.0  # s; needed because damage to a file in place does not change the token
RESTING = ("completed", "incomplete", "cancelled", "failed", "planned")  # states that last until a file changes


class CountedStatuses:
    """Count the rows of campaigns; thread-safe."""

    def __init__(self, store: Store, clock: Callable[[], float] = time.monotonic) -> None:
        self._store, self._clock, self._lock = store, clock, Lock()
        self._kept: OrderedDict[str, tuple[str, float, dict[str, Any]]] = OrderedDict()  # token, time, and document
        self._running: dict[str, Observation] = {}  # the last look at each, by which the next one judges its life

    def status(self, campaign: str) -> dict[str, Any]:
        """Return the `progress_report` of a campaign, seconds old while it runs; faults of files are ``remarks``."""
        token = change_token(self._store, campaign)
        with self._lock:
            known = self._kept.get(campaign)
        if known is not None and known[0] == token and self._clock() - known[1] < RECOUNT_AFTER:
            return known[2]
        remarks: list[str] = []
        seen = observe(self._store, campaign, self._running.get(campaign))
        if seen.state == "running":
            self._running[campaign] = seen
        else:
            self._running.pop(campaign, None)
        document = running_report(self._store, seen, remarks.append)
        if document is None:
            remarks.clear()
            document = progress_report(self._store, self._store.plan_header(campaign), remarks.append)
        document["remarks"] = remarks
        with self._lock:
            self._kept.pop(campaign, None)
            if token is not None and document["state"] in RESTING:
                self._kept[campaign] = token, self._clock(), document
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return document
