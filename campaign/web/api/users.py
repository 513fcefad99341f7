"""Calls for admins that add, change and disable users, and create one-time login links for them."""

from datetime import UTC, datetime
from typing import Annotated, Literal

from fastapi import Path, Query, Request
from pydantic import BaseModel, ConfigDict, Field

from campaign.web.access import Role
from campaign.web.access.sessions import LINK_LIVES
from campaign.web.access.users import LONGEST_PASSWORD, NAME, SHORTEST_PASSWORD, User
from campaign.web.api.calls import calls
from campaign.web.http.asking import Admin, TheService
from campaign.web.http.problems import Refusal, described
from campaign.web.web_service import Service

router = calls("users")

RoleWord = Literal["viewer", "engineer", "approver", "admin"]
UserName = Annotated[str, Path(max_length=100, description="Name of the user", examples=["eva"])]
Password = Annotated[
    str, Field(min_length=SHORTEST_PASSWORD, max_length=LONGEST_PASSWORD, examples=["a long sentence"])
]


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


@router.get("/users")
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


@router.post("/users", status_code=201, responses=described(409))
def add_user(request: Request, service: TheService, _: Admin, new: NewUser) -> ListedUser:
    """Add a user."""
    request.state.detail = f"{new.name[:64]}, {new.role}"
    return ListedUser.of(service.users.add(new.name, Role.of(new.role), new.password))


@router.patch("/users/{name}", responses=described(404, 409))
def change_user(request: Request, service: TheService, _: Admin, name: UserName, change: UserChange) -> ListedUser:
    """Change the role of a user, set their password, or disable them; fields that are left out stay unchanged."""
    known_user(service, name)
    given = change.model_dump(exclude_none=True)
    request.state.detail = ", ".join("password" if key == "password" else f"{key} {given[key]}" for key in given)
    role = None if change.role is None else Role.of(change.role)
    return ListedUser.of(service.users.change(name, role=role, password=change.password, disabled=change.disabled))


@router.post("/users/{name}/login-link", status_code=201, responses=described(404, 409))
def make_login_link(service: TheService, _: Admin, name: UserName) -> LoginLink:
    """Create a one-time login link for a user, valid for fifteen minutes; it is shown only this once."""
    if known_user(service, name).is_disabled:
        raise Refusal(409, f"{name} is disabled, so a link would lead nowhere; enable the account first")
    expires = datetime.fromtimestamp(datetime.now(UTC).timestamp() + LINK_LIVES, UTC)
    return LoginLink(link=login_address(service, name), expires=expires)


def login_address(service: Service, name: str) -> str:
    """Return a new one-time login link for a user."""
    return f"{service.settings.address}/login/link?key={service.sessions.new_link(name)}"
