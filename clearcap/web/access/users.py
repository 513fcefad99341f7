"""The users of a server, their roles, the principal that makes a request, passwords and other secrets."""

import hashlib
import hmac
import re
import secrets
import threading
import time
from dataclasses import dataclass
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
    """A role, which says what a user may do; each role includes the previous ones.

    A viewer reads. An engineer also simulates, submits and ends campaigns. An approver also signs. An admin also
    manages users and reads the audit trail.
    """

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
            with self._database.write() as connection:
                connection.execute(
                    "INSERT INTO users (name, role, password, subject, created) VALUES (?, ?, ?, ?, ?)",
                    (name, role.word, kept, subject, time.time()),
                )
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
        """Change a user; an argument that is None leaves its property unchanged.

        Disabling, and a password that the user has not set himself (`is_own`), ends what `end_access` ends. With an own
        new password only the sessions and one-time links end.
        """
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
        """Return the user with a name and a password; None if the password is wrong or there is no such user.

        Raises TimeoutError if too many other passwords are being checked.
        """
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
