"""Calls for users: accounts for admins, a user's own account, and tokens, by which programs act for a user."""

from datetime import UTC, datetime
from typing import Annotated, Literal

from fastapi import Path, Query, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from clearcap.web.access import Principal, Role
from clearcap.web.access.credentials import LINK_LIVES, Token
from clearcap.web.access.users import LONGEST_PASSWORD, NAME, SHORTEST_PASSWORD, User
from clearcap.web.api.calls import calls
from clearcap.web.http.authentication import Admin, TheService, Viewer, checked_user, lacks_role
from clearcap.web.http.problems import Refusal, described
from clearcap.web.web_service import Service

users_router = calls("users")

RoleWord = Literal["viewer", "engineer", "approver", "admin"]
UserName = Annotated[str, Path(max_length=100, description="Name of the user", examples=["eva"])]
Password = Annotated[
    str, Field(min_length=SHORTEST_PASSWORD, max_length=LONGEST_PASSWORD, examples=["a long sentence"])
]
tokens_router = calls("tokens")
MOST_TOKENS = 100  # valid tokens of a user
DAY = 24 * 3600.0  # s
account_router = calls("account")


class ListedUser(BaseModel):
    """A user, without secrets."""

    name: str = Field(examples=["eva"])
    role: RoleWord = Field(examples=["engineer"])
    created: datetime = Field(examples=["2026-11-23T09:00:00Z"])
    is_disabled: bool = Field(description="The user can neither log in nor use tokens", examples=[False])
    has_password: bool = Field(examples=[True])

    @classmethod
    def of(cls, user: User) -> "ListedUser":
        """Return the listed form of a user."""
        return cls(
            name=user.name,
            role=user.role.word,  # type: ignore[arg-type]  # one of the words
            created=datetime.fromtimestamp(user.created, UTC),
            is_disabled=user.is_disabled,
            has_password=user.has_password,
        )


class UserList(BaseModel):
    """A page of the list of users, by name."""

    users: list[ListedUser]
    next: str | None = Field(description="Cursor of the next page; null on the last one", examples=[None])


class NewUser(BaseModel):
    """A user to be added."""

    model_config = ConfigDict(extra="forbid")
    name: str = Field(
        pattern=f"^{NAME.pattern}$", description="Letters, digits and . _ @ -, 64 characters at most", examples=["eva"]
    )
    role: RoleWord = Field(examples=["engineer"])
    password: Password | None = Field(None, description="Without one the user logs in by a link or the login service")


class UserChange(BaseModel):
    """A change of a user; fields that are left out stay unchanged."""

    model_config = ConfigDict(extra="forbid")
    role: RoleWord | None = Field(None, examples=["approver"])
    password: Password | None = Field(None, description="Ends the sessions of the user")
    disabled: bool | None = Field(None, description="Ends the user's sessions; tokens are refused", examples=[False])


class LoginLink(BaseModel):
    """A one-time login link of a user."""

    link: str = Field(examples=["http://127.0.0.1:8700/login/link?key=clearcap_login_..."])
    expires: datetime = Field(examples=["2026-11-23T09:15:00Z"])


def known_user(service: Service, name: str) -> User:
    """Return the user with a name; raise Refusal (404) if there is none."""
    user = service.users.get(name)
    if user is None:
        raise Refusal(404, f"no user {name!r:.80}")
    return user


@users_router.get("/users")
def list_users(
    service: TheService,
    _: Admin,
    cursor: Annotated[str, Query(max_length=100, description="From the page before")] = "",
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> UserList:
    """List users by name."""
    users = [user for user in service.users.all() if user.name > cursor]
    following = users[limit - 1].name if len(users) > limit else None
    return UserList(users=[ListedUser.of(user) for user in users[:limit]], next=following)


@users_router.post("/users", status_code=201, responses=described(409))
def add_user(request: Request, service: TheService, _: Admin, new: NewUser) -> ListedUser:
    """Add a user."""
    request.state.detail = f"{new.name[:64]}, {new.role}"
    return ListedUser.of(service.users.add(new.name, Role.of(new.role), new.password))


@users_router.patch("/users/{name}", responses=described(404, 409))
def change_user(request: Request, service: TheService, _: Admin, name: UserName, change: UserChange) -> ListedUser:
    """Change the role of a user, set their password, or disable them; fields that are left out stay unchanged."""
    known_user(service, name)
    given = change.model_dump(exclude_none=True)
    request.state.detail = ", ".join("password" if key == "password" else f"{key} {given[key]}" for key in given)
    role = None if change.role is None else Role.of(change.role)
    return ListedUser.of(service.users.change(name, role=role, password=change.password, disabled=change.disabled))


@users_router.post("/users/{name}/login-link", status_code=201, responses=described(404, 409))
def make_login_link(service: TheService, _: Admin, name: UserName) -> LoginLink:
    """Create a one-time login link for a user, valid for fifteen minutes; it is shown only this once."""
    if known_user(service, name).is_disabled:
        raise Refusal(409, f"{name} is disabled, so a link would lead nowhere; enable the account first")
    expires = datetime.fromtimestamp(datetime.now(UTC).timestamp() + LINK_LIVES, UTC)
    return LoginLink(link=login_address(service, name), expires=expires)


def login_address(service: Service, name: str) -> str:
    """Return a new one-time login link for a user."""
    return f"{service.settings.address}/login/link?key={service.sessions.new_link(name)}"


class ListedToken(BaseModel):
    """A token, without its secret."""

    id: int = Field(examples=[1])
    user: str = Field(examples=["eva"])
    name: str = Field(examples=["nightly measurements"])
    role: RoleWord = Field(description="What it may do; never more than its user", examples=["engineer"])
    created: datetime = Field(examples=["2026-11-23T09:00:00Z"])
    expires: datetime = Field(examples=["2027-02-21T09:00:00Z"])
    used: datetime | None = Field(description="When it was last used, to the minute", examples=[None])
    revoked: datetime | None = Field(examples=[None])

    @classmethod
    def of(cls, token: Token) -> "ListedToken":
        """Return the listed form of a token."""
        times = {name: getattr(token, name) for name in ("created", "expires", "used", "revoked")}
        dates = {name: None if at is None else datetime.fromtimestamp(at, UTC) for name, at in times.items()}
        return cls.model_validate(
            {"id": token.id, "user": token.user, "name": token.name, "role": token.role.word, **dates}
        )


class TokenList(BaseModel):
    """A page of the list of tokens, newest first."""

    tokens: list[ListedToken]
    next: int | None = Field(description="Cursor of the next page; null on the last one", examples=[None])


class NewToken(BaseModel):
    """A token to be created."""

    model_config = ConfigDict(extra="forbid")
    name: str = Field(min_length=1, max_length=100, examples=["nightly measurements"])
    role: RoleWord = Field(description="At most your own", examples=["engineer"])
    days: int = Field(90, ge=1, le=366, description="For how long it is valid", examples=[90])


class MadeToken(BaseModel):
    """A token that was just created."""

    token: ListedToken
    secret: str = Field(description="Shown this once: keep it", examples=["clearcap_token_..."])


@tokens_router.get("/tokens")
def list_tokens(
    service: TheService,
    who: Viewer,
    everyone: Annotated[bool, Query(description="Also those of others; for admins")] = False,
    cursor: Annotated[int | None, Query(ge=0, le=2**53, description="From the page before")] = None,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> TokenList:
    """List your tokens, newest first; an admin may also list the tokens of others."""
    if everyone and not who.may(Role.ADMIN):
        raise lacks_role(who, Role.ADMIN, "to list the tokens of others")
    tokens = service.tokens.all(None if everyone else who.name)
    rest = [token for token in tokens if cursor is None or token.id < cursor]
    following = rest[limit - 1].id if len(rest) > limit else None
    return TokenList(tokens=[ListedToken.of(token) for token in rest[:limit]], next=following)


@tokens_router.post("/tokens", status_code=201, responses=described(409))
def add_token(request: Request, service: TheService, who: Viewer, new: NewToken) -> MadeToken:
    """Create a token for yourself; this needs a browser session, so that a token cannot prolong its own life."""
    token, secret = make_token(service, who, new)
    request.state.detail = f"token {token.id}, {new.role}, {new.days} days"
    return MadeToken(token=ListedToken.of(token), secret=secret)


@tokens_router.delete("/tokens/{token}", status_code=204, response_class=Response, responses=described(404))
def revoke_token(
    service: TheService, who: Viewer, token: Annotated[int, Path(ge=0, le=2**53, examples=[1])]
) -> Response:
    """Revoke a token of yours, or, as an admin, of any user."""
    end_token(service, who, token)
    return Response(status_code=204)


def make_token(service: Service, who: Principal, new: NewToken) -> tuple[Token, str]:
    """Create a token; return it and its secret.

    The refusal is 403 if the request itself uses a token, or for a role above the user's own; 409 if the user has too
    many tokens.
    """
    needs_session(who)
    role = Role.of(new.role)
    if not who.may(role):
        raise Refusal(403, f"role = {new.role}: more than your own; allowed: up to {who.role.word}")
    valid = [token for token in service.tokens.all(who.name) if token.is_valid]
    if len(valid) >= MOST_TOKENS:
        raise Refusal(409, f"{who.name} has {len(valid)} tokens; allowed: {MOST_TOKENS}; revoke one")
    return service.tokens.add(who.name, new.name, role, new.days * DAY)


def needs_session(who: Principal) -> None:
    """Raise Refusal (403) unless the request has a session: a token acts for its user, but cannot change access."""
    if who.kind != "session":
        raise Refusal(403, "a token cannot do this; log in with a browser")


def end_token(service: Service, who: Principal, token_id: int) -> None:
    """Revoke a token; raise Refusal (404) if there is none, or it is another user's and `who` is not an admin."""
    mine = service.tokens.all(None if who.may(Role.ADMIN) else who.name)
    if token_id not in {token.id for token in mine}:
        raise Refusal(404, f"no token {token_id} of {who.name}")
    service.tokens.revoke(token_id)


class PasswordChange(BaseModel):
    """A new password, and the one that it replaces."""

    model_config = ConfigDict(extra="forbid")
    present: str | None = Field(None, max_length=2000, description="Not needed if you have none yet")
    password: Password


@account_router.get("/account")
def show_account(service: TheService, who: Viewer) -> ListedUser:
    """Show who you are."""
    return ListedUser.of(known_user(service, who.name))


@account_router.put("/account/password", status_code=204, response_class=Response)
def set_password(request: Request, service: TheService, who: Viewer, change: PasswordChange) -> Response:
    """Change your password; all your sessions end, including this one."""
    change_password(request, service, who, change.present or "", change.password)
    return Response(status_code=204)


@account_router.delete("/account/sessions", status_code=204, response_class=Response)
def end_sessions(service: TheService, who: Viewer) -> Response:
    """End all your sessions, on all machines."""
    service.sessions.end_all(who.name)
    return Response(status_code=204)


def change_password(request: Request, service: Service, who: Principal, present: str, password: str) -> None:
    """Change the password of the user who asks; all their sessions end.

    The refusal is 403 for a token or a wrong present password, 429 after many wrong ones. Raises SpecError if the new
    password is too short or too long.
    """
    needs_session(who)
    if known_user(service, who.name).has_password and checked_user(request, who.name, present) is None:
        raise Refusal(403, "present: is not your password")
    service.users.change(who.name, password=password)
