"""Who may do what: users, sessions, tokens, shares and the audit trail, in one SQLite file."""

from clearcap.web.access.users import Principal, Role

__all__ = ["Principal", "Role"]
