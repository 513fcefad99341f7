"""The principal of a request, who makes it, and the roles that say what they may do."""

from dataclasses import dataclass
from enum import IntEnum


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
