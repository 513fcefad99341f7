"""Who asks, and what he may do."""

from dataclasses import dataclass
from enum import IntEnum


class Role(IntEnum):
    """What a user may do; each role includes those before it.

    A viewer reads. An engineer also simulates, submits and ends campaigns. An approver also signs. An admin also
    manages users and reads the audit trail.
    """

    VIEWER = 1
    ENGINEER = 2
    APPROVER = 3
    ADMIN = 4

    @property
    def word(self) -> str:
        """The role as it is written."""
        return self.name.lower()

    @classmethod
    def of(cls, word: str) -> "Role":
        """Return the role with a name; ValueError if there is none."""
        for role in cls:
            if role.word == word:
                return role
        raise ValueError(f"role = {word!r:.60}; allowed: {', '.join(role.word for role in cls)}")


@dataclass(frozen=True)
class Principal:
    """Who asks.

    Attributes
    ----------
    name : str
        Name of the user; of a share: ``share N``.
    role : Role
        What he may do.
    kind : str
        How he showed who he is: ``session``, ``token`` or ``share``.
    campaign : str or None
        The only campaign that he may see; None: all.
    csrf : str
        What forms and scripts of a session must send with each write; empty for tokens.
    """

    name: str
    role: Role
    kind: str
    campaign: str | None = None
    csrf: str = ""

    def may(self, role: Role) -> bool:
        """Return whether he may do what `role` may do."""
        return self.role >= role

    def may_see(self, campaign_id: str) -> bool:
        """Return whether he may see a campaign."""
        return self.campaign in (None, campaign_id)
