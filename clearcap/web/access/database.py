"""The SQLite file of a server: the data that only the server has, and that is not in the store."""

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from campaign.errors import SpecError, StoreError

DATABASE, KEY_FILE = "service.sqlite", "signing_key.pem"  # files in the data folder of a server
BUSY = 10.0  # s that a writer waits for another process, such as a backup
OF_DISK = {  # SQLite's error codes for a full, read-only or broken disk, or a file that another process keeps locked
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_READONLY,
}
SCHEMA = """
CREATE TABLE users (
    name TEXT PRIMARY KEY, role TEXT NOT NULL, password TEXT, subject TEXT UNIQUE, created REAL NOT NULL,
    disabled INTEGER NOT NULL DEFAULT 0
) STRICT;
CREATE TABLE sessions (
    digest BLOB PRIMARY KEY, user TEXT REFERENCES users(name), share INTEGER REFERENCES shares(id),
    csrf TEXT NOT NULL, created REAL NOT NULL, seen REAL NOT NULL
) STRICT;
CREATE TABLE login_links (
    digest BLOB PRIMARY KEY, user TEXT NOT NULL REFERENCES users(name), expires REAL NOT NULL
) STRICT;
CREATE TABLE tokens (
    id INTEGER PRIMARY KEY, digest BLOB NOT NULL UNIQUE, user TEXT NOT NULL REFERENCES users(name), name TEXT NOT NULL,
    role TEXT NOT NULL, created REAL NOT NULL, expires REAL, used REAL, revoked REAL
) STRICT;
CREATE TABLE shares (
    id INTEGER PRIMARY KEY, digest BLOB NOT NULL UNIQUE, campaign TEXT NOT NULL, by TEXT NOT NULL, note TEXT NOT NULL,
    created REAL NOT NULL, expires REAL NOT NULL, revoked REAL
) STRICT;
CREATE TABLE audit (
    number INTEGER PRIMARY KEY, time REAL NOT NULL, who TEXT NOT NULL, how TEXT NOT NULL, address TEXT NOT NULL,
    action TEXT NOT NULL, object TEXT NOT NULL, status INTEGER NOT NULL, detail TEXT NOT NULL, digest TEXT NOT NULL
) STRICT;
CREATE INDEX audit_by_object ON audit(object);
CREATE TABLE idempotency (
    key TEXT NOT NULL, user TEXT NOT NULL, question TEXT NOT NULL, status INTEGER NOT NULL, answer TEXT NOT NULL,
    time REAL NOT NULL, PRIMARY KEY (key, user)
) STRICT;
CREATE TABLE signoffs (
    id INTEGER PRIMARY KEY, campaign TEXT NOT NULL, document TEXT NOT NULL, signature TEXT NOT NULL
) STRICT;
CREATE INDEX signoffs_by_campaign ON signoffs(campaign);
CREATE TABLE webhooks (
    id INTEGER PRIMARY KEY, user TEXT NOT NULL REFERENCES users(name), campaign TEXT, url TEXT NOT NULL,
    secret TEXT NOT NULL, created REAL NOT NULL
) STRICT;
CREATE TABLE deliveries (
    id INTEGER PRIMARY KEY, webhook INTEGER NOT NULL REFERENCES webhooks(id) ON DELETE CASCADE, event TEXT NOT NULL,
    body TEXT NOT NULL, attempts INTEGER NOT NULL, next REAL, status TEXT NOT NULL, UNIQUE (webhook, event)
) STRICT;
"""
# The number of a deleted webhook is never reused, because receivers recognize repeated news by it.
NUMBERED_WEBHOOKS = """
CREATE TABLE numbered_webhooks (
    id INTEGER PRIMARY KEY AUTOINCREMENT, user TEXT NOT NULL REFERENCES users(name), campaign TEXT, url TEXT NOT NULL,
    secret TEXT NOT NULL, created REAL NOT NULL
) STRICT;
INSERT INTO numbered_webhooks SELECT * FROM webhooks;
DROP TABLE webhooks;
ALTER TABLE numbered_webhooks RENAME TO webhooks;
"""
VERSIONS = (SCHEMA, NUMBERED_WEBHOOKS)  # statements that upgrade each version of the tables to the next


class Database:
    """An SQLite file shared by all threads of a server: one thread writes at a time, and readers wait for no writer.

    A missing file is created, readable by its owner only. Raises SpecError if a later version wrote the file, or it is
    not a database. Like the methods, it raises StoreError if the disk is full, read-only or broken.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._writing, self._reading = threading.RLock(), threading.Lock()
        try:
            path.touch(0o600)
            self._connection = sqlite3.connect(path, timeout=BUSY, isolation_level=None, check_same_thread=False)
        except (OSError, sqlite3.OperationalError) as error:  # such as a folder in its place
            raise self._unusable(error) from error
        self._connection.row_factory = sqlite3.Row
        try:
            self._prepare()
            # a separate connection, so that readers need not wait for the disk writes of others
            self._reader = sqlite3.connect(path, timeout=BUSY, isolation_level=None, check_same_thread=False)
            self._reader.row_factory = sqlite3.Row
            self._reader.execute("PRAGMA query_only = ON")
        except StoreError:
            self._connection.close()
            raise
        except sqlite3.DatabaseError as error:
            self._connection.close()
            if _is_of_disk(error):
                raise self._unusable(error) from error
            raise SpecError(f"{path}: is not the database of a server ({error}); restore it from a backup") from error

    def _prepare(self) -> None:
        """Create the tables of a new file, upgrade those of an old one, and refuse those of a later clearcap."""
        # a write that a client was told of survives a power failure
        settings = "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = OFF;"
        self._connection.executescript(settings)
        before = self._connection.execute("PRAGMA user_version").fetchone()[0]
        if 0 < before < len(VERSIONS):  # the earlier clearcap refuses the upgraded file
            copy_of(self.path, self.path.with_name(f"{self.path.name}.version-{before}"))
        with self.write() as connection:
            version = connection.execute("PRAGMA user_version").fetchone()[0]
            for statement in ";\n".join(VERSIONS[version:]).split(";\n"):
                connection.execute(statement)
            connection.execute(f"PRAGMA user_version = {max(version, len(VERSIONS))}")
        if version > len(VERSIONS):
            self._connection.close()
            raise SpecError(
                f"{self.path}: has version {version} of the tables, and this clearcap knows {len(VERSIONS)}; use the"
                " clearcap that wrote it, or a later one"
            )
        # only now: an upgrade that replaces a table deletes its rows for a moment, and would cascade to other tables
        self._connection.execute("PRAGMA foreign_keys = ON")

    @contextmanager
    def write(self) -> Iterator[sqlite3.Connection]:
        """Run the block in a transaction; `rows` sees what it writes after the block."""
        with self._writing, self._faults_of_the_disk():
            try:
                self._connection.execute("BEGIN IMMEDIATE")
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:  # SQLite may have rolled back by itself
                    with suppress(sqlite3.OperationalError):
                        self._connection.execute("ROLLBACK")
                raise

    def change(self, statement: str, *values: object) -> list[sqlite3.Row]:
        """Run one statement as a transaction; return the rows that it returns."""
        with self.write() as connection:
            return connection.execute(statement, values).fetchall()

    def note(self, statement: str, *values: object) -> None:
        """Write what may get lost, unless another connection writes or the disk fails, so that readers never wait."""
        if not self._writing.acquire(blocking=False):
            return
        try:
            self._connection.execute("PRAGMA busy_timeout = 0")
            with suppress(sqlite3.OperationalError):
                self._connection.execute(statement, values)
            self._connection.execute(f"PRAGMA busy_timeout = {1e3 * BUSY:.0f}")
        finally:
            self._writing.release()

    def rows(self, statement: str, *values: object) -> list[sqlite3.Row]:
        """Return the rows of a query."""
        with self._reading, self._faults_of_the_disk():
            return self._reader.execute(statement, values).fetchall()

    def row(self, statement: str, *values: object) -> sqlite3.Row | None:
        """Return the first row of a query; None if it has no rows."""
        rows = self.rows(statement, *values)
        return rows[0] if rows else None

    def close(self) -> None:
        """Close the file."""
        with self._writing, self._reading:
            self._reader.close()
            self._connection.close()

    @contextmanager
    def _faults_of_the_disk(self) -> Iterator[None]:
        """Turn SQLite's errors about the disk into StoreError."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if not _is_of_disk(error):
                raise
            raise self._unusable(error) from error

    def _unusable(self, error: Exception) -> StoreError:
        """Return the error for a file that cannot be used now."""
        return StoreError(f"{self.path}: cannot be used now ({error}); free or repair its disk, then try again")


def copy_of(path: Path, target: Path) -> None:
    """Copy a database that others may be writing, to a file readable by its owner only; a target is replaced."""
    target.unlink(missing_ok=True)
    target.touch(0o600)
    with (
        closing(sqlite3.connect(f"file:{path}?mode=ro", timeout=BUSY, uri=True)) as source,
        closing(sqlite3.connect(target, isolation_level=None)) as copied,
    ):
        source.backup(copied)
        copied.execute("PRAGMA journal_mode = DELETE")  # one file, without others beside it


def _is_of_disk(error: sqlite3.DatabaseError) -> bool:
    """Return whether an error is due to the disk and not to the file's content."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in OF_DISK
