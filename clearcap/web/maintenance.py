"""What an operator does beside a server that may run: back its data up, restore them, and see what is wrong.

A backup is one file that is whole or not there at all, with what only the server has: its database and its key. SQLite
itself copies the database, so a backup made while others write has everything that was acknowledged before it began.
The store is copied by whatever copies files, after this: what a sign-off names was in the store before it.
"""

import io
import json
import os
import shutil
import sqlite3
import struct
import sys
import tempfile
import time
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.kdf.scrypt import Scrypt

from campaign.coordinator.lease import is_coordinated
from campaign.coordinator.state import state_of
from campaign.errors import CampaignError, SpecError
from campaign.row_build import clearcap_version, row_build, short_build
from campaign.store import Store
from campaign.store.layout import SERVICE
from campaign.waits import counted
from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.database import DATABASE, KEY_FILE, VERSIONS, Database, copy_of
from engine.platform.regular_file import read_regular_file

MANIFEST = "backup.json"
FORMAT = 1
LARGEST = 2**31  # bytes of a backup, and of each file in it
_ENCRYPTED = b"clearcap backup, encrypted 1\n"  # how such a file begins; salt and nonce follow
_SALT, _NONCE = 16, 12  # bytes
_COST, _BLOCK, _PARALLEL = 2**15, 8, 1  # of scrypt
# what reading an archive or a database raises if its content is damaged
_OF_CONTENT = (
    *(ValueError, KeyError, TypeError, EOFError, RuntimeError),
    *(zipfile.BadZipFile, zlib.error, struct.error, sqlite3.Error),
)


@dataclass(frozen=True)
class Contents:
    """What a backup has, as its manifest says and a check of it finds."""

    time: float  # when it began [s since 1970]
    version: str  # of the clearcap that made it
    users: int
    audit: int  # entries of the audit trail
    newest: str  # digest of the last one
    signoffs: int  # signed documents
    files: dict[str, str]  # SHA-256 by name


def back_up(data: Path, target: Path, now: float, passphrase: str | None = None) -> Contents:
    """Write a backup of a server's folder `data` to a new file, mode 0600; if asked encrypted (AES-256-GCM)."""
    if not (data / DATABASE).is_file():
        raise SpecError(f"--data {data}: has no {DATABASE}; name the folder of a server")
    if target.exists():
        raise SpecError(f"{target}: exists; name a new file, so that no backup replaces another")
    with TemporaryDirectory(prefix=".backup-", dir=data) as folder:  # on a disk that may keep secrets already
        copied = Path(folder) / DATABASE
        copy_of(data / DATABASE, copied)
        files = {DATABASE: read_regular_file(copied, LARGEST)}
        with suppress(FileNotFoundError):  # a server that has never started has none
            files[KEY_FILE] = read_regular_file(data / KEY_FILE, LARGEST)
        contents = _found(copied, now, clearcap_version(), files)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr(MANIFEST, json.dumps({"format": FORMAT, **asdict(contents)}, indent=1))
        for name, content in files.items():
            made.writestr(name, content)
    content = archive.getvalue()
    _write_whole(target, content if passphrase is None else _encrypted(content, passphrase))
    return contents


def check_backup(file: Path, passphrase: str | None = None) -> Contents:
    """Return what a backup has, after checking all of it; raise SpecError if it is damaged."""
    with TemporaryDirectory(prefix="clearcap-backup-") as folder:
        return _unpacked(file, Path(folder), passphrase)


def restore(file: Path, data: Path, passphrase: str | None = None) -> Contents:
    """Make the folder `data` of a server from a backup; it gets its name once it is checked and on the disk."""
    if data.exists() and any(data.iterdir()):
        raise SpecError(f"--data {data}: is not empty; move it away first, or name a new folder")
    data.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=f".{data.name}-", dir=data.parent) as folder:
        made = Path(folder) / data.name
        made.mkdir(0o700)
        contents = _unpacked(file, made, passphrase)
        for path in (*made.iterdir(), made):
            _to_disk(path)
        made.replace(data)
        _to_disk(data.parent)
    return contents


def _unpacked(file: Path, folder: Path, passphrase: str | None) -> Contents:
    """Write the files of a backup into a folder, and check them; return what it has."""
    try:
        content = read_regular_file(file, LARGEST)
    except OSError as error:
        raise SpecError(f"{file}: cannot be read: {error.strerror or error}") from error
    if content.startswith(_ENCRYPTED):
        content = _decrypted(file, content, passphrase)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if any(entry.file_size > LARGEST for entry in archive.infolist()):
                raise ValueError("a file in it is too large")
            manifest: dict[str, Any] = json.loads(archive.read(MANIFEST))
            if manifest.pop("format") != FORMAT:
                raise ValueError("has another format; use the clearcap that made it")
            said = Contents(**manifest)
            if not {DATABASE} <= said.files.keys() <= {DATABASE, KEY_FILE}:
                raise ValueError("has other files")
            files = {name: archive.read(name) for name in said.files}
            for name, each in files.items():
                with open(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as written:
                    written.write(each)
            found = _found(folder / DATABASE, said.time, said.version, files)
            if found != said:
                raise ValueError("its files are not those that it lists")
    except _OF_CONTENT as error:
        raise SpecError(f"{file}: is no whole backup ({error}); use another one") from error
    return said


def _found(database: Path, time: float, version: str, files: dict[str, bytes]) -> Contents:
    """Check a database and return what it has; raise ValueError if it is damaged."""
    with closing(sqlite3.connect(f"file:{database}?mode=ro&immutable=1", uri=True)) as opened:
        opened.row_factory = sqlite3.Row
        [fault] = opened.execute("PRAGMA integrity_check(1)").fetchone()
        if fault != "ok":
            raise SpecError(f"{database.name}: is damaged ({fault:.200})")

        def count(table: str) -> int:
            return int(opened.execute(f"SELECT count(*) FROM {table}").fetchone()[0])

        last = opened.execute("SELECT digest FROM audit ORDER BY number DESC LIMIT 1").fetchone()
        return Contents(
            time=time,
            version=version,
            users=count("users"),
            audit=count("audit"),
            newest=last["digest"] if last else "",
            signoffs=count("signoffs"),
            files={name: sha256(content).hexdigest() for name, content in files.items()},
        )


def audit_fault(data: Path) -> int | None:
    """Return the first entry of the audit trail in a folder that was changed or is missing; None if it is whole."""
    with closing(Database(data / DATABASE)) as database:
        return AuditTrail(database).first_fault()


def _encrypted(content: bytes, passphrase: str) -> bytes:
    salt, nonce = os.urandom(_SALT), os.urandom(_NONCE)
    return _ENCRYPTED + salt + nonce + AESGCM(_key(passphrase, salt)).encrypt(nonce, content, _ENCRYPTED)


def _decrypted(file: Path, content: bytes, passphrase: str | None) -> bytes:
    if passphrase is None:
        raise SpecError(f"{file}: is encrypted; give --encrypted, and its passphrase")
    content = content[len(_ENCRYPTED) :]
    salt, nonce, rest = content[:_SALT], content[_SALT : _SALT + _NONCE], content[_SALT + _NONCE :]
    try:
        return AESGCM(_key(passphrase, salt)).decrypt(nonce, rest, _ENCRYPTED)
    except (InvalidTag, ValueError) as error:
        raise SpecError(f"{file}: cannot be decrypted: another passphrase, or it is damaged") from error


def _key(passphrase: str, salt: bytes) -> bytes:
    return Scrypt(salt=salt, length=32, n=_COST, r=_BLOCK, p=_PARALLEL).derive(passphrase.encode())


def _write_whole(target: Path, content: bytes) -> None:
    """Write a file that others cannot read, and that is whole or does not exist."""
    unfinished = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        with open(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.link(unfinished, target)  # fails if the target exists, which `replace` would not
    except FileExistsError as error:
        raise CampaignError(f"{target}: was written meanwhile by another backup; name another file") from error
    except OSError as error:
        raise SpecError(f"{target}: cannot be written ({error.strerror}); name a file in a folder of yours") from error
    finally:
        unfinished.unlink(missing_ok=True)
    _to_disk(target.parent)


def _to_disk(path: Path) -> None:
    """Have the content of a file or folder written to the disk."""
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


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
    of_store = (partial(look, store) for look in (_versions, _store, _clock, _queue))
    for look in (*of_store, *(partial(look, data) for look in (_folder, _database))):
        what = look.func.__name__.removeprefix("_")
        try:
            for status, text in look():
                found.append(Finding(what, status, text))
        except (CampaignError, OSError, sqlite3.Error) as error:
            found.append(Finding(what, FAULT, str(error)))
    return found


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
