"""What stands for a user in requests: browser sessions, API tokens, and shared links that show one campaign."""

import secrets
import time
from dataclasses import dataclass, fields
from sqlite3 import Row

from clearcap.web.access.database import Database
from clearcap.web.access.users import Principal, Role, digest, end_sessions, new_secret

IDLE = 12 * 3600.0  # s without a request, after which a session ends
LONGEST_SESSION = 7 * 24 * 3600.0  # s
LINK_LIVES = 15 * 60.0  # s that a one-time link can be used
SEEN_EVERY = 60.0  # s between two updates of the time of a session's last request
LONGEST_TOKEN = 366 * 24 * 3600.0  # s
LONGEST_SHARE = 90 * 24 * 3600.0  # s
USED_EVERY = 60.0  # s between two updates of the time of a token's last use


@dataclass(frozen=True)
class Token:
    """A token as lists show it, without its secret; times in seconds since 1970."""

    id: int
    user: str
    name: str  # given by the user
    role: Role  # never permits more than the role of the user
    created: float
    expires: float
    used: float | None  # last use
    revoked: float | None

    @property
    def is_valid(self) -> bool:
        """Whether it has neither expired nor been revoked."""
        return self.revoked is None and self.expires > time.time()


@dataclass(frozen=True)
class SharedLink:
    """A shared link as lists show it, without its secret; times in seconds since 1970."""

    id: int
    campaign: str  # the only one that it shows
    by: str  # who shared it
    note: str  # such as for whom it is
    created: float
    expires: float
    revoked: float | None

    @property
    def is_valid(self) -> bool:
        """Whether it has neither expired nor been revoked."""
        return self.revoked is None and self.expires > time.time()


class Tokens:
    """The tokens and shared links of a server."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, user: str, name: str, role: Role, seconds: float) -> tuple[Token, str]:
        """Create a token that lives `seconds` [s]; return it and its secret, which is not kept."""
        secret, now = new_secret("token"), time.time()
        with self._database.write() as connection:
            row = connection.execute(
                "INSERT INTO tokens (digest, user, name, role, created, expires) VALUES (?, ?, ?, ?, ?, ?) RETURNING *",
                (digest(secret), user, name, role.word, now, now + min(seconds, LONGEST_TOKEN)),
            ).fetchone()
        return _token(row), secret

    def all(self, user: str | None = None) -> list[Token]:
        """Return the tokens of a user, or of all users, newest first."""
        where = "" if user is None else " WHERE user = ?"
        rows = self._database.rows(f"SELECT * FROM tokens{where} ORDER BY id DESC", *([] if user is None else [user]))
        return [_token(row) for row in rows]

    def revoke(self, token_id: int) -> None:
        """Revoke a token; do nothing if it is revoked already."""
        with self._database.write() as connection:
            connection.execute(
                "UPDATE tokens SET revoked = ? WHERE id = ? AND revoked IS NULL", (time.time(), token_id)
            )

    def share(self, campaign: str, by: str, note: str, seconds: float) -> tuple[SharedLink, str]:
        """Create a link to one campaign that lives `seconds` [s]; return it and its secret, which is not kept."""
        secret, now = new_secret("share"), time.time()
        with self._database.write() as connection:
            row = connection.execute(
                "INSERT INTO shares (digest, campaign, by, note, created, expires) VALUES (?, ?, ?, ?, ?, ?)"
                " RETURNING *",
                (digest(secret), campaign, by, note, now, now + min(seconds, LONGEST_SHARE)),
            ).fetchone()
        return _shared_link(row), secret

    def shares(self, campaign: str) -> list[SharedLink]:
        """Return the shared links to a campaign, newest first."""
        rows = self._database.rows("SELECT * FROM shares WHERE campaign = ? ORDER BY id DESC", campaign)
        return [_shared_link(row) for row in rows]

    def revoke_share(self, campaign: str, share_id: int) -> bool:
        """Revoke a shared link and end the sessions it began; return whether the campaign has such a link."""
        with self._database.write() as connection:
            changed = connection.execute(
                "UPDATE shares SET revoked = coalesce(revoked, ?) WHERE id = ? AND campaign = ?",
                (time.time(), share_id, campaign),
            ).rowcount
            if changed:
                connection.execute("DELETE FROM sessions WHERE share = ?", (share_id,))
        return bool(changed)

    def shared(self, secret: str) -> SharedLink | None:
        """Return the shared link with a secret; None if there is none, or it was revoked or has expired."""
        row = self._database.row(
            "SELECT * FROM shares WHERE digest = ? AND revoked IS NULL AND expires > ?", digest(secret), time.time()
        )
        return _shared_link(row) if row else None

    def principal(self, secret: str) -> Principal | None:
        """Return the principal of a token or shared link; None if there is none, or it was revoked or has expired."""
        if share := self.shared(secret):
            return Principal(f"share {share.id}", Role.VIEWER, "share", share.campaign)
        now = time.time()
        row = self._database.row(
            "SELECT t.id, t.used, t.role, u.name, u.role AS most FROM tokens t JOIN users u ON u.name = t.user"
            " WHERE t.digest = ? AND t.revoked IS NULL AND t.expires > ? AND NOT u.disabled",
            digest(secret), now,
        )  # fmt: skip
        if row is None:
            return None
        if now - (row["used"] or 0.0) > USED_EVERY:
            self._database.note("UPDATE tokens SET used = ? WHERE id = ?", now, row["id"])
        return Principal(row["name"], min(Role.of(row["role"]), Role.of(row["most"])), "token")


def _token(row: Row) -> Token:
    """Return the token of a database row."""
    return Token(**{**{each.name: row[each.name] for each in fields(Token)}, "role": Role.of(row["role"])})


def _shared_link(row: Row) -> SharedLink:
    """Return the shared link of a database row."""
    return SharedLink(**{each.name: row[each.name] for each in fields(SharedLink)})


class Sessions:
    """The sessions of a server's users."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def begin(self, user: str | None = None, share: int | None = None) -> str:
        """Begin a session of a user or of a shared link; return the secret for its cookie."""
        secret, now = new_secret("session"), time.time()
        with self._database.write() as connection:
            connection.execute(
                "DELETE FROM sessions WHERE seen < ? OR created < ?", (now - IDLE, now - LONGEST_SESSION)
            )
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
            digest(secret), now - IDLE, now - LONGEST_SESSION, now,
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
            end_sessions(connection, user)

    def count(self, user: str) -> int:
        """Return the number of a user's open sessions."""
        now = time.time()
        statement = "SELECT count(*) FROM sessions WHERE user = ? AND seen > ? AND created > ?"
        row = self._database.row(statement, user, now - IDLE, now - LONGEST_SESSION)
        return int(row[0]) if row else 0

    def new_link(self, user: str) -> str:
        """Return the secret of a link that logs a user in once, within fifteen minutes."""
        secret, now = new_secret("login"), time.time()
        with self._database.write() as connection:
            connection.execute("DELETE FROM login_links WHERE expires < ?", (now,))
            connection.execute("INSERT INTO login_links VALUES (?, ?, ?)", (digest(secret), user, now + LINK_LIVES))
        return secret

    def user_of_link(self, secret: str) -> str | None:
        """Return the user whom a one-time link would log in; the link is not used up."""
        statement = "SELECT user FROM login_links WHERE digest = ? AND expires > ?"
        row = self._database.row(statement, digest(secret), time.time())
        return row["user"] if row else None

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
