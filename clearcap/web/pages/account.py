"""The page of the user's own account: tokens, password, sessions."""

from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from starlette.responses import RedirectResponse, Response

from clearcap.web.access import Principal, Role
from clearcap.web.access.users import LONGEST_PASSWORD, SHORTEST_PASSWORD
from clearcap.web.http.authentication import TheService, Viewer
from clearcap.web.http.problems import Refusal
from clearcap.web.operations.people import (
    ListedId,
    ListedToken,
    NewToken,
    PasswordChange,
    RoleWord,
    add_token,
    end_sessions,
    known_user,
    revoke_token,
    set_password,
)
from clearcap.web.pages.login import entered
from clearcap.web.pages.rendering import page
from clearcap.web.web_service import Service

router = APIRouter(include_in_schema=False)
ACCOUNT = "/account"


@router.get(ACCOUNT)
def account_page(request: Request, service: TheService, who: Viewer) -> Response:
    """Show the user's tokens, and the forms for password and sessions."""
    return _account_page(request, service, who)


@router.post(f"{ACCOUNT}/tokens")
def token_form(
    request: Request,
    service: TheService,
    who: Viewer,
    name: Annotated[str, Form(min_length=1, max_length=100)],
    role: Annotated[RoleWord, Form()],
    days: Annotated[int, Form(ge=1, le=366)] = 90,
) -> Response:
    """Create a token, and show its secret this once."""
    made = add_token(request, service, who, NewToken(name=name, role=role, days=days))
    return _account_page(request, service, who, secret=made.secret)


@router.post(f"{ACCOUNT}/tokens/{{token}}/revoke")
def revoke_form(service: TheService, who: Viewer, token: ListedId) -> Response:
    """Revoke a token."""
    revoke_token(service, who, token)
    return RedirectResponse(ACCOUNT, 303)


@router.post(f"{ACCOUNT}/password")
def password_form(
    request: Request,
    service: TheService,
    who: Viewer,
    password: Annotated[str, Form(min_length=SHORTEST_PASSWORD, max_length=LONGEST_PASSWORD)],
    again: Annotated[str, Form(max_length=LONGEST_PASSWORD)],
    present: Annotated[str, Form(max_length=2000)] = "",
) -> Response:
    """Change the user's password; all sessions end, and this browser gets a new one."""
    if password != again:
        raise Refusal(422, "again: is not the same password; type it twice")
    set_password(request, service, who, PasswordChange(present=present, password=password))
    return entered(request, service.sessions.begin(who.name), ACCOUNT)


@router.post(f"{ACCOUNT}/sessions/end")
def end_sessions_form(service: TheService, who: Viewer) -> Response:
    """End all sessions, including this one."""
    end_sessions(service, who)
    return RedirectResponse("/login", 303)


def _account_page(request: Request, service: Service, who: Principal, secret: str = "") -> Response:
    """Return the page, with the secret of a token that was just created."""
    values: dict[str, Any] = {
        "user": known_user(service, who.name),
        "tokens": [ListedToken.model_validate(token) for token in service.tokens.all(who.name) if token.is_valid],
        "roles": [role.word for role in Role if who.may(role)],
        "sessions": service.sessions.count(who.name),
        "secret": secret,
        "shortest": SHORTEST_PASSWORD,
        "longest": LONGEST_PASSWORD,
    }
    return page(request, "account", **values)
