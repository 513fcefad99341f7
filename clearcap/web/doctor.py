"""What is wrong with a store and the folder of its server, as an operator asks before users do: ``clearcap doctor``.

Nothing is changed. Each finding says what was looked at, whether it is as it should be, and the remedy.
"""

import os
import shutil
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from campaign.coordinator.lease import is_coordinated
from campaign.coordinator.state import state_of
from campaign.errors import CampaignError
from campaign.row_build import clearcap_version, row_build, short_build
from campaign.store import Store
from campaign.store.layout import SERVICE
from campaign.waits import counted
from clearcap.web.access.backup import KEY_FILE, audit_fault
from clearcap.web.access.database import DATABASE, VERSIONS

OK, WARNING, FAULT = "ok", "warning", "fault"
LEAST_FREE, LEAST_SHARE = 2**30, 0.05  # bytes, and share of a disk, that should be free
CLOCK_WITHIN = 2.0  # s, by which the clocks of this machine and of the store may differ
_UNFINISHED = ("queued", "running", "interrupted")


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    what: str
    status: str  # `OK`, `WARNING` or `FAULT`
    text: str  # what is so; and the remedy, if it should not be


def examine(store: Store, data: Path) -> list[Finding]:
    """Look at a store and at the folder of its server, which may run; what cannot be looked at is a fault."""
    found = list[Finding]()
    for what, look in (
        ("versions", lambda: _versions(store)),
        ("store", lambda: _store(store)),
        ("clock", lambda: _clock(store)),
        ("queue", lambda: _queue(store)),
        ("folder", lambda: _folder(data)),
        ("database", lambda: _database(data)),
    ):
        found += _findings(what, look)
    return found


def _findings(what: str, look: Callable[[], Iterator[tuple[str, str]]]) -> Iterator[Finding]:
    """Yield what a look finds; an error of it is a fault."""
    try:
        for status, text in look():
            yield Finding(what, status, text)
    except (CampaignError, OSError, sqlite3.Error) as error:
        yield Finding(what, FAULT, str(error))


def _versions(store: Store) -> Iterator[tuple[str, str]]:
    """Compare this build with those of the campaigns that are not finished."""
    python = ".".join(map(str, sys.version_info[:3]))
    yield OK, f"clearcap {clearcap_version()}, build {short_build()}, Python {python}"
    unfinished = [each for each in store.campaigns() if state_of(store, each)["state"] in _UNFINISHED]
    others = [each for each in unfinished if store.plan(each).row_build != row_build()]
    if others:
        yield (
            WARNING,
            f"{counted(len(others), 'unfinished campaign')}, such as {others[0]}, of another build, which alone can go"
            " on with that: finish or cancel it there",
        )


def _store(store: Store) -> Iterator[tuple[str, str]]:
    """Check that the store can be read and written, and has room."""
    if store.files.local and not Path(store.files.path("")).is_dir():
        yield WARNING, f"{store.url}: does not exist yet; the first campaign makes it"
        return
    count = len(store.folders())
    store.files.check_writable()
    yield OK, f"{store.url} can be read and written; {counted(count, 'campaign')}"
    if store.files.local:
        yield _room(Path(store.files.path("")))


def _room(folder: Path) -> tuple[str, str]:
    """Return whether the disk of a folder has room."""
    usage = shutil.disk_usage(folder)
    words = f"{usage.free / 1e9:.1f} of {usage.total / 1e9:.1f} GB are free on the disk of {folder}"
    is_enough = usage.free >= max(LEAST_FREE, LEAST_SHARE * usage.total)
    return (OK, words) if is_enough else (WARNING, f"{words}: free some; a full disk stops campaigns and sign-offs")


def _clock(store: Store) -> Iterator[tuple[str, str]]:
    """Compare the clock of this machine with that of the store's disk, by which leases are judged."""
    if not store.files.local or not Path(store.files.path("")).is_dir():
        yield OK, "not looked at: the store is behind a URL, or not there yet"
        return
    with tempfile.TemporaryFile(dir=store.files.path("")) as file:
        before = time.time()
        file.write(b"x")
        file.flush()
        off = os.fstat(file.fileno()).st_mtime - before
    words = f"the store's clock is {abs(off):.1f} s {'ahead' if off > 0 else 'behind'}"
    is_near = abs(off) <= CLOCK_WITHIN
    yield (OK, words) if is_near else (FAULT, f"{words}: set both by NTP; machines judge by it who has ended")


def _queue(store: Store) -> Iterator[tuple[str, str]]:
    """Tell whether a coordinator serves what is queued."""
    states = [state_of(store, each)["state"] for each in store.campaigns()]
    waiting = sum(state in ("queued", "interrupted") for state in states)
    words = f"{counted(waiting, 'campaign')} queued, {counted(states.count('running'), 'campaign')} running"
    if waiting and not is_coordinated(store, SERVICE):
        yield (
            WARNING,
            f"{words}; no coordinator serves the store: start {store.command('coordinate')}, or a server without"
            " --no-drive",
        )
    else:
        yield OK, words


def _folder(data: Path) -> Iterator[tuple[str, str]]:
    """Check who may read the folder of a server, and its room."""
    if not data.is_dir():
        yield WARNING, f"{data}: no server has used this folder; name another one with --data"
        return
    for path in (data, data / KEY_FILE, data / DATABASE):
        if path.exists() and (mode := path.stat().st_mode & 0o777) & 0o077:
            yield FAULT, f"{path}: others may use it (mode {mode:o}): chmod go= {path}"
        elif path.exists() and path.stat().st_uid != os.getuid():
            yield FAULT, f"{path}: belongs to another user; run this as the user of the server"
    yield _room(data)


def _database(data: Path) -> Iterator[tuple[str, str]]:
    """Check the database of a server: its pages, version and audit trail."""
    path = data / DATABASE
    if not path.exists():
        return
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as opened:
        [fault] = opened.execute("PRAGMA integrity_check(1)").fetchone()
        [version] = opened.execute("PRAGMA user_version").fetchone()
    if fault != "ok":
        yield FAULT, f"{path}: is damaged ({fault:.200}): restore it from a backup"
        return
    if version != len(VERSIONS):
        words = "the next start raises it, and keeps a copy" if version < len(VERSIONS) else "use the later clearcap"
        yield WARNING, f"{path}: has version {version} of the tables, and this clearcap has {len(VERSIONS)}: {words}"
        return
    entry = audit_fault(data)
    if entry is not None:
        yield FAULT, f"{path}: entry {entry} of the audit trail was changed, or is missing: compare it with a backup"
    else:
        yield OK, f"{path}: whole, version {version}, its audit trail is whole"
