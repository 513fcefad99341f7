"""Calls for tokens, with which programs send requests in the name of a user."""

from datetime import UTC, datetime
from typing import Annotated

from fastapi import Path, Query, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from campaign.web.access import Principal, Role
from campaign.web.access.tokens import Token
from campaign.web.api.calls import calls
from campaign.web.api.users import RoleWord
from campaign.web.http.asking import TheService, Viewer, lacks_role
from campaign.web.http.problems import Refusal, described
from campaign.web.web_service import Service

router = calls("tokens")
MOST_TOKENS = 100  # valid tokens of a user
DAY = 24 * 3600.0  # s


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


@router.get("/tokens")
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


@router.post("/tokens", status_code=201, responses=described(409))
def add_token(request: Request, service: TheService, who: Viewer, new: NewToken) -> MadeToken:
    """Create a token for yourself; this needs a browser session, so that a token cannot prolong its own life."""
    token, secret = make_token(service, who, new)
    request.state.detail = f"token {token.id}, {new.role}, {new.days} days"
    return MadeToken(token=ListedToken.of(token), secret=secret)


@router.delete("/tokens/{token}", status_code=204, response_class=Response, responses=described(404))
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
