"""Users of a server: by name and password, or by a company's login service."""

import re
import threading
import time
from dataclasses import dataclass
from sqlite3 import IntegrityError, Row

from campaign.errors import CampaignError, SpecError
from campaign.web.access.database import Database
from campaign.web.access.principal import Role
from campaign.web.access.secret_words import hash_password, is_password

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")
SHORTEST_PASSWORD = 12
LONGEST_PASSWORD = 1024
CHECKS = 2  # passwords that are checked at the same time: each takes 32 MiB and 0.1 s of a processor
CHECK_WITHIN = 2.0  # s, for which one more waits for its turn


@dataclass(frozen=True)
class User:
    """A user.

    Attributes
    ----------
    name : str
    role : Role
    created : float
        When the user was added [s since 1970].
    is_disabled : bool
        The user can neither log in nor use tokens.
    has_password : bool
        He can log in with a password.
    """

    name: str
    role: Role
    created: float
    is_disabled: bool
    has_password: bool


class Users:
    """The users of a server.

    Parameters
    ----------
    database : Database
        Where they are kept.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._turns = threading.BoundedSemaphore(CHECKS)

    def all(self) -> list[User]:
        """Return all users by name."""
        return [_user(row) for row in self._database.rows("SELECT * FROM users ORDER BY name")]

    def get(self, name: str) -> User | None:
        """Return the user with a name; None if there is none."""
        row = self._database.row("SELECT * FROM users WHERE name = ?", name)
        return _user(row) if row else None

    def add(self, name: str, role: Role, password: str | None = None, subject: str | None = None) -> User:
        """Add a user.

        Parameters
        ----------
        name : str
            Letters, digits and ``. _ @ -``, at most 64.
        role : Role
        password : str, optional
            Without one the user logs in by a link or the login service.
        subject : str, optional
            Who he is to the login service.

        Raises
        ------
        SpecError
            If the name is not allowed, or the password too short.
        CampaignError
            If the name is taken.
        """
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
            raise CampaignError(f"name = {name}: there is a user of this name; choose another") from error
        user = self.get(name)
        assert user is not None
        return user

    def change(
        self, name: str, *, role: Role | None = None, password: str | None = None, disabled: bool | None = None
    ) -> User:
        """Change a user; what is None stays.

        His sessions and one-time links end when he gets another password or is disabled.

        Raises
        ------
        SpecError
            If there is no such user, or the password is too short.
        CampaignError
            If no admin would be left.
        """
        if self.get(name) is None:
            raise SpecError(f"name = {name!r:.80}: there is no user of this name")
        kept = None if password is None else hash_password(_checked(password))
        with self._database.write() as connection:
            if role is not None:
                connection.execute("UPDATE users SET role = ? WHERE name = ?", (role.word, name))
            if kept is not None:
                connection.execute("UPDATE users SET password = ? WHERE name = ?", (kept, name))
            if disabled is not None:
                connection.execute("UPDATE users SET disabled = ? WHERE name = ?", (disabled, name))
            if kept is not None or disabled:
                connection.execute("DELETE FROM sessions WHERE user = ?", (name,))
                connection.execute("DELETE FROM login_links WHERE user = ?", (name,))
            admins = "SELECT count(*) FROM users WHERE role = 'admin' AND NOT disabled"
            if connection.execute(admins).fetchone()[0] == 0:
                raise CampaignError(f"name = {name}: is the last admin; make another user an admin first")
        user = self.get(name)
        assert user is not None
        return user

    def by_password(self, name: str, password: str) -> User | None:
        """Return the user with a name and a password; None if they do not belong together.

        Raises
        ------
        TimeoutError
            If too many passwords are being checked to take another one.
        """
        row = self._database.row("SELECT * FROM users WHERE name = ? AND NOT disabled", name)
        if not self._turns.acquire(timeout=CHECK_WITHIN):
            raise TimeoutError
        try:
            is_right = is_password(password[: LONGEST_PASSWORD + 1], row["password"] if row else None)
        finally:
            self._turns.release()
        return _user(row) if row and is_right else None

    def by_subject(self, subject: str) -> User | None:
        """Return the user whom the login service knows as `subject`, even if he is disabled; None if there is none."""
        row = self._database.row("SELECT * FROM users WHERE subject = ?", subject)
        return _user(row) if row else None


def _checked(password: str) -> str:
    """Return a password that is long enough to be kept."""
    if not SHORTEST_PASSWORD <= len(password) <= LONGEST_PASSWORD:
        raise SpecError(f"password: has {len(password)} characters; allowed: {SHORTEST_PASSWORD} to {LONGEST_PASSWORD}")
    return password


def _user(row: Row) -> User:
    """Return a user from his row."""
    has_password = row["password"] is not None
    return User(row["name"], Role.of(row["role"]), row["created"], bool(row["disabled"]), has_password)
