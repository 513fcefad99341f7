"""Keys of requests that may be sent twice: a client that lost an answer sends the same key and gets the same answer."""

import time

from campaign.errors import SpecError
from campaign.web.access.database import Database

KEPT = 24 * 3600.0  # s
_IN_WORK = 0  # status of a request that is not answered yet


class KeyTaken(SpecError):
    """The key was sent with another content before."""


class RequestKeys:
    """The keys of a server's database, each a user's own.

    Parameters
    ----------
    database : Database
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def claim(self, user: str, key: str, question: str, now: float | None = None) -> tuple[int, str] | None:
        """Note that a request begins; return status and text of its answer if it was answered before.

        A request that was begun and not answered, because the server was killed, begins again.

        Parameters
        ----------
        user, key : str
        question : str
            Digest of what was sent.
        now : float, optional
            By default the clock [s since 1970].

        Raises
        ------
        KeyTaken
            If the key was sent with another content within a day.
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
        """Keep the answer to a request; return the one that was kept first, if it was sent twice at the same time."""
        with self._database.write() as connection:
            connection.execute(
                "UPDATE idempotency SET status = ?, answer = ? WHERE key = ? AND user = ? AND status = ?",
                (status, answer, key, user, _IN_WORK),
            )
        kept = self._database.row("SELECT status, answer FROM idempotency WHERE key = ? AND user = ?", key, user)
        return (status, answer) if kept is None else (kept["status"], kept["answer"])

    def release(self, user: str, key: str) -> None:
        """Forget a key whose request was refused: corrected, it may be sent with the same key."""
        with self._database.write() as connection:
            connection.execute(
                "DELETE FROM idempotency WHERE key = ? AND user = ? AND status = ?", (key, user, _IN_WORK)
            )
