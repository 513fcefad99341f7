"""Idempotency keys: a client that lost an answer repeats the request with the same key and gets the same answer."""

import time

from campaign.errors import SpecError
from clearcap.web.access.database import Database

KEPT = 24 * 3600.0  # s
_IN_WORK = 0  # status of a request that is not answered yet


class KeyTaken(SpecError):
    """The key was sent before, with different content."""


class RequestKeys:
    """The idempotency keys in a server's database; each user has their own."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def claim(self, user: str, key: str, question: str, now: float | None = None) -> tuple[int, str] | None:
        """Note that a request begins; return the status and text of its answer if it was answered before, else None.

        A request that was begun but not answered, because the server was killed, may begin again. `question` is a
        digest of the request's content. Raises KeyTaken if the key was sent with different content within the last day.
        """
        at = time.time() if now is None else now
        with self._database.write() as connection:
            connection.execute("DELETE FROM idempotency WHERE time < ?", (at - KEPT,))
            found = connection.execute(
                "SELECT question, status, answer FROM idempotency WHERE key = ? AND user = ?", (key, user)
            ).fetchone()
            if found is None:
                connection.execute(
                    "INSERT INTO idempotency VALUES (?, ?, ?, ?, '', ?)", (key, user, question, _IN_WORK, at)
                )
                return None
        if found["question"] != question:
            raise KeyTaken(f"Idempotency-Key {key!r:.80}: was sent with other content before; use a new key")
        return None if found["status"] == _IN_WORK else (found["status"], found["answer"])

    def keep(self, user: str, key: str, status: int, answer: str) -> tuple[int, str]:
        """Keep the answer to a request and return it; return the first one if the request was sent twice at once."""
        with self._database.write() as connection:
            connection.execute(
                "UPDATE idempotency SET status = ?, answer = ? WHERE key = ? AND user = ? AND status = ?",
                (status, answer, key, user, _IN_WORK),
            )
        kept = self._database.row("SELECT status, answer FROM idempotency WHERE key = ? AND user = ?", key, user)
        return (status, answer) if kept is None else (kept["status"], kept["answer"])

    def release(self, user: str, key: str) -> None:
        """Forget the key of a refused request, so that the corrected request may use the same key."""
        with self._database.write() as connection:
            connection.execute(
                "DELETE FROM idempotency WHERE key = ? AND user = ? AND status = ?", (key, user, _IN_WORK)
            )
