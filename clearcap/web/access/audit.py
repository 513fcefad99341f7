"""The audit trail: who did what, when. The digest of an entry covers the previous one, so that a removal shows."""

import hashlib
import json
import time
from dataclasses import asdict, dataclass

from clearcap.web.access.database import Database

_BEGINNING = "0" * 64
_PAGE = 1000  # entries read at a time, so that other queries can run in between


@dataclass(frozen=True)
class Entry:
    """One entry of the audit trail."""

    number: int  # consecutive, from 1, without gaps
    time: float  # [s since 1970]
    who: str
    how: str  # kind of login: session, token or share
    address: str  # of the client
    action: str  # method and route
    object: str  # what the action was applied to
    status: int  # of HTTP; below 400 the action was carried out
    detail: str
    digest: str  # SHA-256 of the previous entry's digest and of all fields above


class AuditTrail:
    """The audit trail of a server."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, who: str, how: str, address: str, action: str, subject: str, status: int, detail: str = "") -> Entry:
        """Add an entry; it is on the disk when this returns."""
        with self._database.write() as connection:
            last = connection.execute("SELECT number, digest FROM audit ORDER BY number DESC LIMIT 1").fetchone()
            number, before = (last["number"] + 1, last["digest"]) if last else (1, _BEGINNING)
            entry = Entry(number, time.time(), who, how, address, action, subject, status, detail, "")
            entry = Entry(**{**asdict(entry), "digest": _digest(before, entry)})
            connection.execute(f"INSERT INTO audit VALUES ({', '.join('?' * 10)})", tuple(asdict(entry).values()))
        return entry

    def newest(
        self, before: int | None = None, subject: str | None = None, who: str | None = None, count: int = 100
    ) -> list[Entry]:
        """Return up to `count` entries, newest first: those numbered below `before`, of one object, by one user."""
        own = None if subject is None else f"{subject} "  # "demo-1 3", shared link 3 of demo-1, belongs to demo-1
        bounds = [("number < ?", before), ("instr(object || ' ', ?) = 1", own), ("who = ?", who)]
        given = [(condition, value) for condition, value in bounds if value is not None]
        where = f"WHERE {' AND '.join(condition for condition, _ in given)}" if given else ""
        statement = f"SELECT * FROM audit {where} ORDER BY number DESC LIMIT ?"
        return [Entry(**dict(row)) for row in self._database.rows(statement, *(value for _, value in given), count)]

    def first_fault(self) -> int | None:
        """Return the number of the first entry that was changed or is missing; None if the trail is intact."""
        before, expected = _BEGINNING, 1
        while rows := self._database.rows(
            "SELECT * FROM audit WHERE number >= ? ORDER BY number LIMIT ?", expected, _PAGE
        ):
            for row in rows:
                entry = Entry(**dict(row))
                if entry.number != expected or entry.digest != _digest(before, entry):
                    return expected
                before, expected = entry.digest, expected + 1
        return None


def _digest(before: str, entry: Entry) -> str:
    """Return the digest of an entry that follows an entry with the digest `before`."""
    content = {name: value for name, value in asdict(entry).items() if name != "digest"}
    return hashlib.sha256((before + json.dumps(content, sort_keys=True)).encode()).hexdigest()
