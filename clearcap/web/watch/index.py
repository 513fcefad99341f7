"""What a server knows of the campaigns of its store, read again only when their files have changed.

The list entry of each is in a file that may be deleted at any time, because it is built again from the store; the
counted rows are kept in memory.
"""

import sqlite3
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from typing import Any

from pydantic import ValidationError

from campaign.coordinator.heartbeat import Observation, observe
from campaign.coordinator.progress_report import progress_report, running_report
from campaign.errors import CampaignError, unwritable
from campaign.store import Store
from campaign.store.store import change_token
from clearcap.web.watch.entry import CampaignEntry, entry_of

FORMAT = 2
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

    def refresh(self, store: Store, tokens: Mapping[str, str]) -> None:
        """Read again all campaigns that have changed, and drop those that are gone; see `look` and `read_some`."""
        self.look(tokens)
        while self.is_behind:
            self.read_some(store)

    def look(self, tokens: Mapping[str, str]) -> None:
        """Drop the campaigns that are gone, and find those that must be read again because they have changed.

        Queued and running campaigns are always read, because neither their progress nor the death of their coordinator
        changes their token; see `campaign.store.store`.
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
        """Return the `progress_report` of a campaign, with the faults of its files as ``remarks``.

        The counts of a running campaign are those of its coordinator, at most some seconds old. Raises StoreError if
        the store cannot be read, or has no such campaign.
        """
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
