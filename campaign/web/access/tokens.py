"""API tokens, which act for a user, and shared links, which show one campaign."""

import time
from dataclasses import dataclass
from sqlite3 import Row

from campaign.web.access.database import Database
from campaign.web.access.principal import Principal, Role
from campaign.web.access.secret_words import digest, new_secret

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
    times = (row["created"], row["expires"], row["used"], row["revoked"])
    return Token(row["id"], row["user"], row["name"], Role.of(row["role"]), *times)


def _shared_link(row: Row) -> SharedLink:
    """Return the shared link of a database row."""
    times = (row["created"], row["expires"], row["revoked"])
    return SharedLink(row["id"], row["campaign"], row["by"], row["note"], *times)
