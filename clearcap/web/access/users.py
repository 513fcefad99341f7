"""The users of a server, and what stands for them in requests: passwords, browser sessions, tokens, shared links."""

import hashlib
import hmac
import re
import secrets
import threading
import time
from dataclasses import dataclass, fields
from enum import IntEnum
from sqlite3 import Connection, IntegrityError, Row

from campaign.errors import CampaignError, SpecError
from clearcap.web.access.database import Database

WORD_BYTES = 32
_COST, _BLOCK, _PARALLEL = 2**15, 8, 1  # of scrypt: 32 MiB and about 0.1 s per password


def new_secret(kind: str) -> str:
    """Return a new secret; `kind` is part of its prefix, by which scanners find secrets in repositories."""
    return f"clearcap_{kind}_{secrets.token_urlsafe(WORD_BYTES)}"


def digest(secret: str) -> bytes:
    """Return the digest that is kept of a secret; SHA-256 suffices, because the secret has 256 random bits."""
    return hashlib.sha256(secret.encode(errors="surrogatepass")).digest()


def hash_password(password: str) -> str:
    """Return the hash that is kept of a password: scrypt with a random salt."""
    salt = secrets.token_bytes(16)
    return f"scrypt${salt.hex()}${_scrypt(password, salt).hex()}"


def is_password(password: str, kept: str | None) -> bool:
    """Return whether a password matches a kept hash; without a hash the answer takes as long, so that nothing shows."""
    _, salt, expected = (kept or f"scrypt${bytes(16).hex()}${bytes(32).hex()}").split("$")
    is_equal = hmac.compare_digest(_scrypt(password, bytes.fromhex(salt)), bytes.fromhex(expected))
    return is_equal and kept is not None


def _scrypt(password: str, salt: bytes) -> bytes:
    text = password.encode(errors="surrogatepass")
    return hashlib.scrypt(text, salt=salt, n=_COST, r=_BLOCK, p=_PARALLEL, maxmem=64 * 1024**2, dklen=32)


NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")
SHORTEST_PASSWORD = 12
LONGEST_PASSWORD = 1024
CHECKS = 2  # passwords that are checked at the same time: each takes 32 MiB and 0.1 s of processor time
CHECK_WITHIN = 2.0  # s that a further check waits for its turn


class Role(IntEnum):
    """What a user may do: a viewer reads, an engineer also computes, an approver signs, an admin manages users."""

    VIEWER = 1
    ENGINEER = 2
    APPROVER = 3
    ADMIN = 4

    @property
    def word(self) -> str:
        """The name of the role as files and messages spell it, such as ``viewer``."""
        return self.name.lower()

    @classmethod
    def of(cls, word: str) -> "Role":
        """Return the role with the name `word`; raise ValueError if there is none."""
        for role in cls:
            if role.word == word:
                return role
        raise ValueError(f"role = {word!r:.60}; allowed: {', '.join(role.word for role in cls)}")


@dataclass(frozen=True)
class Principal:
    """The user or shared link in whose name a request is made."""

    name: str  # of the user; ``share N`` for a shared link
    role: Role
    kind: str  # identified by a ``session``, ``token`` or ``share``
    campaign: str | None = None  # the only one that the principal may see; None if all
    csrf: str = ""  # token that forms and scripts of a session send with each write; empty for tokens

    def may(self, role: Role) -> bool:
        """Return whether the principal may do what `role` may do."""
        return self.role >= role

    def may_see(self, campaign_id: str) -> bool:
        """Return whether the principal may see a campaign."""
        return self.campaign in (None, campaign_id)


@dataclass(frozen=True)
class User:
    """A user."""

    name: str
    role: Role
    created: float  # [s since 1970]
    is_disabled: bool  # can neither log in nor use tokens
    has_password: bool  # can log in with a password


class Users:
    """The users of a server."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._checks = threading.BoundedSemaphore(CHECKS)

    def all(self) -> list[User]:
        """Return all users, sorted by name."""
        return [_user(row) for row in self._database.rows("SELECT * FROM users ORDER BY name")]

    def get(self, name: str) -> User | None:
        """Return the user with a name; None if there is none."""
        row = self._database.row("SELECT * FROM users WHERE name = ?", name)
        return _user(row) if row else None

    def add(self, name: str, role: Role, password: str | None = None, subject: str | None = None) -> User:
        """Add a user, who without a password logs in by a link or the login service."""
        if not NAME.fullmatch(name):
            raise SpecError(
                f"name = {name!r:.80}: not allowed; allowed: 1 to 64 letters, digits and . _ @ -,"
                " a letter or digit first"
            )
        kept = None if password is None else hash_password(_checked(password))
        try:
            statement = "INSERT INTO users (name, role, password, subject, created) VALUES (?, ?, ?, ?, ?)"
            self._database.change(statement, name, role.word, kept, subject, time.time())
        except IntegrityError as error:
            raise CampaignError(f"name = {name}: a user of this name exists already; choose another") from error
        user = self.get(name)
        assert user is not None
        return user

    def change(
        self,
        name: str,
        *,
        role: Role | None = None,
        password: str | None = None,
        disabled: bool | None = None,
        is_own: bool = False,
    ) -> User:
        """Change a user; disabling ends all access, as does a password unless it `is_own`, which ends logins only."""
        if self.get(name) is None:
            raise SpecError(f"name = {name!r:.80}: no user has this name")
        kept = None if password is None else hash_password(_checked(password))
        with self._database.write() as connection:
            if role is not None:
                connection.execute("UPDATE users SET role = ? WHERE name = ?", (role.word, name))
            if kept is not None:
                connection.execute("UPDATE users SET password = ? WHERE name = ?", (kept, name))
            if disabled is not None:
                connection.execute("UPDATE users SET disabled = ? WHERE name = ?", (disabled, name))
            if kept is not None or disabled:
                end_sessions(connection, name)
            if (kept is not None or disabled) and not is_own:
                _end_grants(connection, name)
            admins = "SELECT count(*) FROM users WHERE role = 'admin' AND NOT disabled"
            if connection.execute(admins).fetchone()[0] == 0:
                raise CampaignError(f"name = {name}: is the last admin; make another user an admin first")
        user = self.get(name)
        assert user is not None
        return user

    def end_access(self, name: str) -> None:
        """End all sessions, one-time links, tokens, shared links and webhooks of a user."""
        with self._database.write() as connection:
            end_sessions(connection, name)
            _end_grants(connection, name)

    def by_password(self, name: str, password: str) -> User | None:
        """Return the user with a name and a password; TimeoutError if too many passwords are being checked."""
        row = self._database.row("SELECT * FROM users WHERE name = ? AND NOT disabled", name)
        if not self._checks.acquire(timeout=CHECK_WITHIN):
            raise TimeoutError
        try:
            # also without such a user, so that the time taken does not tell which names exist
            is_right = is_password(password[: LONGEST_PASSWORD + 1], row["password"] if row else None)
        finally:
            self._checks.release()
        return _user(row) if row and is_right else None

    def by_subject(self, subject: str) -> User | None:
        """Return the user whom the login service knows as `subject`, even a disabled one; None if there is none."""
        row = self._database.row("SELECT * FROM users WHERE subject = ?", subject)
        return _user(row) if row else None


def end_sessions(connection: Connection, name: str) -> None:
    """End all sessions of a user, and the unused one-time links."""
    connection.execute("DELETE FROM sessions WHERE user = ?", (name,))
    connection.execute("DELETE FROM login_links WHERE user = ?", (name,))


def _end_grants(connection: Connection, name: str) -> None:
    """End what a user has granted to programs and others: tokens, shared links with their sessions, webhooks."""
    now = time.time()
    connection.execute("UPDATE tokens SET revoked = ? WHERE user = ? AND revoked IS NULL", (now, name))
    connection.execute("DELETE FROM sessions WHERE share IN (SELECT id FROM shares WHERE by = ?)", (name,))
    connection.execute("UPDATE shares SET revoked = ? WHERE by = ? AND revoked IS NULL", (now, name))
    connection.execute("DELETE FROM webhooks WHERE user = ?", (name,))


def _checked(password: str) -> str:
    """Return a password if its length is allowed; raise SpecError otherwise."""
    if not SHORTEST_PASSWORD <= len(password) <= LONGEST_PASSWORD:
        raise SpecError(f"password: has {len(password)} characters; allowed: {SHORTEST_PASSWORD} to {LONGEST_PASSWORD}")
    return password


def _user(row: Row) -> User:
    """Return the user of a database row."""
    has_password = row["password"] is not None
    return User(row["name"], Role.of(row["role"]), row["created"], bool(row["disabled"]), has_password)


IDLE = 12 * 3600.0  # s without a request, after which a session ends
LONGEST_SESSION = 7 * 24 * 3600.0  # s
LINK_LIVES = 15 * 60.0  # s that a one-time link can be used
SEEN_EVERY = 60.0  # s between two updates of the time of a session's last request
LONGEST_TOKEN = 366 * 24 * 3600.0  # s
LONGEST_SHARE = 90 * 24 * 3600.0  # s
USED_EVERY = 60.0  # s between two updates of the time of a token's last use


class _Lent:
    """What is valid for some time, unless it is revoked."""

    expires: float
    revoked: float | None

    @property
    def is_valid(self) -> bool:
        """Whether it has neither expired nor been revoked."""
        return self.revoked is None and self.expires > time.time()


@dataclass(frozen=True)
class Token(_Lent):
    """A token as lists show it, without its secret; times in seconds since 1970."""

    id: int
    user: str
    name: str  # given by the user
    role: Role  # never permits more than the role of the user
    created: float
    expires: float
    used: float | None  # last use
    revoked: float | None


@dataclass(frozen=True)
class SharedLink(_Lent):
    """A shared link as lists show it, without its secret; times in seconds since 1970."""

    id: int
    campaign: str  # the only one that it shows
    by: str  # who shared it
    note: str  # such as for whom it is
    created: float
    expires: float
    revoked: float | None


class Tokens:
    """The tokens and shared links of a server."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, user: str, name: str, role: Role, seconds: float) -> tuple[Token, str]:
        """Create a token that lives `seconds` [s]; return it and its secret, which is not kept."""
        secret, now = new_secret("token"), time.time()
        [row] = self._database.change(
            "INSERT INTO tokens (digest, user, name, role, created, expires) VALUES (?, ?, ?, ?, ?, ?) RETURNING *",
            digest(secret), user, name, role.word, now, now + min(seconds, LONGEST_TOKEN),
        )  # fmt: skip
        return _token(row), secret

    def all(self, user: str | None = None) -> list[Token]:
        """Return the tokens of a user, or of all users, newest first."""
        where = "" if user is None else " WHERE user = ?"
        rows = self._database.rows(f"SELECT * FROM tokens{where} ORDER BY id DESC", *([] if user is None else [user]))
        return [_token(row) for row in rows]

    def revoke(self, token_id: int) -> None:
        """Revoke a token; do nothing if it is revoked already."""
        statement = "UPDATE tokens SET revoked = ? WHERE id = ? AND revoked IS NULL"
        self._database.change(statement, time.time(), token_id)

    def share(self, campaign: str, by: str, note: str, seconds: float) -> tuple[SharedLink, str]:
        """Create a link to one campaign that lives `seconds` [s]; return it and its secret, which is not kept."""
        secret, now = new_secret("share"), time.time()
        [row] = self._database.change(
            "INSERT INTO shares (digest, campaign, by, note, created, expires) VALUES (?, ?, ?, ?, ?, ?) RETURNING *",
            digest(secret), campaign, by, note, now, now + min(seconds, LONGEST_SHARE),
        )  # fmt: skip
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
            ended = (now - IDLE, now - LONGEST_SESSION)
            connection.execute("DELETE FROM sessions WHERE seen < ? OR created < ?", ended)
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
        self._database.change("DELETE FROM sessions WHERE digest = ?", digest(secret))

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
        rows = self._database.change(  # one statement, so that of two simultaneous uses only one succeeds
            "DELETE FROM login_links WHERE digest = ? RETURNING expires, (SELECT name FROM users"
            " WHERE name = login_links.user AND NOT disabled) AS name",
            digest(secret),
        )
        return rows[0]["name"] if rows and rows[0]["expires"] >= time.time() else None
