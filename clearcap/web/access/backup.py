"""A backup of what only the server has: its database and its key, in one file that is whole or not there at all.

The database is copied by SQLite itself, so a backup made while others write has everything that was acknowledged before
it began. The store is copied by whatever copies files, after this: what a sign-off names was in the store before it.
"""

import io
import json
import os
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.kdf.scrypt import Scrypt

from campaign.errors import CampaignError, SpecError
from campaign.row_build import clearcap_version
from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.database import DATABASE, Database, copy_of
from engine.platform.regular_file import read_regular_file

KEY_FILE = "signing_key.pem"
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
    """Write a backup of the folder `data` of a server, which may run, to a new file `target`, mode 0600.

    With a passphrase it is encrypted (AES-256-GCM with a key from scrypt). Raises SpecError if there is no database, it
    is damaged, or the target exists.
    """
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
    """Make the folder `data` of a server from a backup; raise SpecError if it has a database, or the file is damaged.

    The folder gets its name when everything in it is checked and on the disk, so a restore that is killed leaves none.
    """
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
    with _damaged(file), zipfile.ZipFile(io.BytesIO(content)) as archive:
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


@contextmanager
def _damaged(file: Path) -> Iterator[None]:
    """Turn what goes wrong with the content of a backup into SpecError."""
    try:
        yield
    except _OF_CONTENT as error:
        raise SpecError(f"{file}: is no whole backup ({error}); use another one") from error


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
