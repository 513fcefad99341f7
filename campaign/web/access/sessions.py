"""Browser sessions, which begin with a password, a one-time link, the login service, or a shared link."""

import secrets
import time

from campaign.web.access.database import Database
from campaign.web.access.principal import Principal, Role
from campaign.web.access.secret_words import digest, new_secret

IDLE = 12 * 3600.0  # s without a request, after which a session ends
LONGEST = 7 * 24 * 3600.0  # s
LINK_LIVES = 15 * 60.0  # s that a one-time link can be used
SEEN_EVERY = 60.0  # s between two updates of the time of a session's last request


class Sessions:
    """The sessions of a server's users."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def begin(self, user: str | None = None, share: int | None = None) -> str:
        """Begin a session of a user or of a shared link; return the secret for its cookie."""
        secret, now = new_secret("session"), time.time()
        with self._database.write() as connection:
            connection.execute("DELETE FROM sessions WHERE seen < ? OR created < ?", (now - IDLE, now - LONGEST))
            connection.execute(
                "INSERT INTO sessions (digest, user, share, csrf, created, seen) VALUES (?, ?, ?, ?, ?, ?)",
                (digest(secret), user, share, secrets.token_urlsafe(24), now, now),
            )
        return secret

    def principal(self, secret: str) -> Principal | None:
        """Return the principal of the session with a cookie; None if there is no such session or it has ended."""
        now = time.time()
        row = self._database.row(
            "SELECT s.digest, s.csrf, s.seen, s.share, u.name, u.role, h.campaign"
            " FROM sessions s LEFT JOIN users u ON u.name = s.user LEFT JOIN shares h ON h.id = s.share"
            " WHERE s.digest = ? AND s.seen > ? AND s.created > ? AND coalesce(u.disabled, 0) = 0"
            " AND (h.id IS NULL OR (h.revoked IS NULL AND h.expires > ?))",
            digest(secret), now - IDLE, now - LONGEST, now,
        )  # fmt: skip
        if row is None:
            return None
        if now - row["seen"] > SEEN_EVERY:
            self._database.note("UPDATE sessions SET seen = ? WHERE digest = ?", now, row["digest"])
        if row["share"] is not None:
            return Principal(f"share {row['share']}", Role.VIEWER, "share", row["campaign"], row["csrf"])
        return Principal(row["name"], Role.of(row["role"]), "session", csrf=row["csrf"])

    def end(self, secret: str) -> None:
        """End a session."""
        with self._database.write() as connection:
            connection.execute("DELETE FROM sessions WHERE digest = ?", (digest(secret),))

    def end_all(self, user: str) -> None:
        """End all sessions of a user, and the user's unused one-time links."""
        with self._database.write() as connection:
            connection.execute("DELETE FROM sessions WHERE user = ?", (user,))
            connection.execute("DELETE FROM login_links WHERE user = ?", (user,))

    def count(self, user: str) -> int:
        """Return the number of a user's open sessions."""
        now = time.time()
        statement = "SELECT count(*) FROM sessions WHERE user = ? AND seen > ? AND created > ?"
        row = self._database.row(statement, user, now - IDLE, now - LONGEST)
        return int(row[0]) if row else 0

    def new_link(self, user: str) -> str:
        """Return the secret of a link that logs a user in once, within fifteen minutes."""
        secret, now = new_secret("login"), time.time()
        with self._database.write() as connection:
            connection.execute("DELETE FROM login_links WHERE expires < ?", (now,))
            connection.execute("INSERT INTO login_links VALUES (?, ?, ?)", (digest(secret), user, now + LINK_LIVES))
        return secret

    def use_link(self, secret: str) -> str | None:
        """Use up a one-time link and return its user; None if it was used, has expired, or the user is disabled."""
        with self._database.write() as connection:
            row = connection.execute(
                # one statement, so that of two simultaneous uses only one succeeds
                "DELETE FROM login_links WHERE digest = ? RETURNING expires, (SELECT name FROM users"
                " WHERE name = login_links.user AND NOT disabled) AS name",
                (digest(secret),),
            ).fetchone()
        return None if row is None or row["expires"] < time.time() else row["name"]
