"""The pages of everybody: to log in, by password, link or company account, to log out; the own account; help."""

from typing import Annotated, Any
from urllib.parse import urlsplit

from fastapi import APIRouter, Depends, Form, Request
from starlette.responses import RedirectResponse, Response

from clearcap.web.access import Principal, Role
from clearcap.web.access.company_login import LOGIN_WITHIN, CompanyLogin, LoginFault, company_user
from clearcap.web.access.throttle import place_of
from clearcap.web.access.users import LONGEST_PASSWORD, SHORTEST_PASSWORD
from clearcap.web.http.authentication import (
    COOKIE,
    SHARE_COOKIE,
    WHO_MAY,
    TheService,
    Viewer,
    address_of,
    authenticated,
    check_origin,
    checked_user,
    principal_of,
)
from clearcap.web.http.responses import Refusal
from clearcap.web.operations import people
from clearcap.web.pages.rendering import SITE, FormText, NewPassword, page
from clearcap.web.settings import PREFIX
from clearcap.web.web_service import Service

HOME = "/campaigns"
METHODS = ("get", "post", "put", "patch", "delete")
ACCOUNT = "/account"
router = APIRouter(include_in_schema=False)
BEGUN = "__Host-clearcap-login"  # cookie of a login in progress


@router.get("/")
async def home() -> Response:
    """Redirect to the list of campaigns."""
    return RedirectResponse(HOME, 303)


@router.get("/favicon.ico")
async def icon() -> Response:
    """Redirect to the icon; browsers ask here if they show a document that, unlike a page, does not name its icon."""
    return RedirectResponse("/static/icon.svg", 308)


@router.get("/login")
async def show_login(request: Request, service: TheService, next: str = HOME) -> Response:
    """Show the login form."""
    return page(request, "login", next=own_path(next), has_oidc=service.settings.oidc is not None, fault="")


@router.post("/login")
def log_in(
    request: Request,
    service: TheService,
    name: Annotated[str, Form(max_length=100)],
    password: FormText,
    next: FormText = HOME,
) -> Response:
    """Begin a session with a name and password."""
    check_origin(request)
    # an unknown name is not audited: it may be a password that was typed into the wrong field
    request.state.who, request.state.how = name if service.users.get(name) else "unknown", "password"
    user = checked_user(request, name, password)
    if user is None:
        has_oidc = service.settings.oidc is not None
        fault = "name and password do not belong together"
        return page(request, "login", 401, next=own_path(next), has_oidc=has_oidc, fault=fault)
    return entered(request, service.sessions.begin(user.name), next)


@router.get("/login/link")
def open_link(request: Request, service: TheService, key: str, next: str = HOME) -> Response:
    """Begin a session with a one-time link that was typed or pasted; otherwise, or instead of another session, ask."""
    user = service.sessions.user_of_link(key)
    if user is None:
        raise _used_up()
    present = service.sessions.principal(request.cookies.get(COOKIE, ""))
    # after a link on another site the browser does not send the cookie of a session that it may have
    is_typed = request.headers.get("sec-fetch-site") in ("none", "same-origin")
    if is_typed and (present is None or present.name == user):
        return _by_link(request, service, key, next)
    return page(request, "login_link", user=user, present=present, key=key, next=own_path(next))


@router.post("/login/link")
def use_link(request: Request, service: TheService, key: FormText, next: FormText = HOME) -> Response:
    """Begin a session with a one-time link."""
    check_origin(request)
    return _by_link(request, service, key, next)


def _by_link(request: Request, service: Service, key: str, wanted: str) -> Response:
    """Use up a one-time link and begin a session of its user."""
    user = service.sessions.use_link(key)
    if user is None:
        raise _used_up()
    request.state.who, request.state.how = user, "link"
    if request.method == "GET":  # of others the middleware makes the entry
        service.audit.add(user, "link", address_of(request), "GET /login/link", "", 200)
    return entered(request, service.sessions.begin(user), wanted)


def _used_up() -> Refusal:
    return Refusal(
        403, "this link was used, or is older than 15 minutes; an admin, or clearcap serve --login-link, makes another"
    )


@router.get("/shared/{secret}")
def use_share(request: Request, service: TheService, secret: str) -> Response:
    """Begin a session that shows one campaign only."""
    share = service.tokens.shared(secret)
    if share is None:
        raise Refusal(403, "this link has expired or was revoked; ask who sent it for another")
    service.audit.add(f"share {share.id}", "share", address_of(request), "GET /shared", share.campaign, 200)
    return entered(request, service.sessions.begin(share=share.id), f"/campaigns/{share.campaign}", SHARE_COOKIE)


@router.post("/logout")
def log_out(request: Request, service: TheService, _: Annotated[Principal, Depends(authenticated)]) -> Response:
    """End the session."""
    answer = RedirectResponse("/login", 303)
    for name in (COOKIE, SHARE_COOKIE):
        service.sessions.end(request.cookies.get(name, ""))
        answer.delete_cookie(name, path="/", secure=True, httponly=True, samesite="strict")
    return answer


def entered(request: Request, secret: str, wanted: str, cookie: str = COOKIE) -> Response:
    """Return the page that completes a login; it sets the session's cookie and goes on to the wanted page by itself.

    A redirect will not do: after a link on another site a browser does not send a strict cookie to its target.
    """
    answer = page(request, "entered", wanted=own_path(wanted))
    answer.set_cookie(cookie, secret, path="/", secure=True, httponly=True, samesite="strict")
    return answer


def own_path(wanted: str) -> str:
    """Return the wanted path if it is on this server, otherwise that of the first page."""
    try:
        parts = urlsplit(wanted)
    except ValueError:
        return HOME
    is_own = not parts.scheme and not parts.netloc and wanted.startswith("/") and not wanted.startswith(("//", "/\\"))
    return wanted if is_own and wanted.isprintable() else HOME


@router.get("/login/company")
def go_to_company(service: TheService, next: str = HOME) -> Response:
    """Send the browser to the login service."""
    try:
        url, kept = _company(service).begin(own_path(next))
    except LoginFault as fault:
        raise _refusal(fault) from fault
    answer = RedirectResponse(url, 303)
    # the service sends the browser back from another site, so this cookie alone cannot be strict
    answer.set_cookie(BEGUN, kept, LOGIN_WITHIN, path="/", secure=True, httponly=True, samesite="lax")
    return answer


@router.get("/login/company/callback")
def back_from_company(request: Request, service: TheService) -> Response:
    """Begin a session for the user whom the login service names."""
    company, place = _company(service), f"company {place_of(address_of(request))}"
    if wait := service.throttle.attempt(place):
        headers = {"Retry-After": f"{wait + 1:.0f}"}
        raise Refusal(429, f"too many failed logins; wait {wait:.0f} s and try again", headers=headers)
    try:
        identity, wanted = company.end(request.query_params, request.cookies.get(BEGUN, ""))
        user = company_user(service.users, identity)
    except LoginFault as fault:
        service.audit.add("unknown", "company", address_of(request), "GET /login/company/callback", "", 403, str(fault))
        raise _refusal(fault) from fault
    service.throttle.take_back(place)
    service.audit.add(user.name, "company", address_of(request), "GET /login/company/callback", "", 200, user.role.word)
    answer = entered(request, service.sessions.begin(user.name), wanted)
    answer.delete_cookie(BEGUN, path="/", secure=True, httponly=True, samesite="lax")
    return answer


def _company(service: Service) -> CompanyLogin:
    """Return the login service; raise Refusal (404) if this server has none."""
    if service.company is None:
        raise Refusal(404, "this server has no login service of a company; log in by a password or a link")
    return service.company


def _refusal(fault: LoginFault) -> Refusal:
    """Return the refusal for a fault of a login."""
    if fault.is_outage:
        return Refusal(503, str(fault), headers={"Retry-After": "30"})
    return Refusal(403, str(fault))


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
    role: Annotated[people.RoleWord, Form()],
    days: Annotated[int, Form(ge=1, le=366)] = 90,
) -> Response:
    """Create a token, and show its secret this once."""
    made = people.add_token(request, service, who, people.NewToken(name=name, role=role, days=days))
    return _account_page(request, service, who, secret=made.secret)


@router.post(f"{ACCOUNT}/tokens/{{token}}/revoke")
def revoke_form(service: TheService, who: Viewer, token: people.ListedId) -> Response:
    """Revoke a token."""
    people.revoke_token(service, who, token)
    return RedirectResponse(ACCOUNT, 303)


@router.post(f"{ACCOUNT}/password")
def password_form(
    request: Request, service: TheService, who: Viewer, password: NewPassword, again: FormText, present: FormText = ""
) -> Response:
    """Change the user's password; all sessions end, and this browser gets a new one."""
    if password != again:
        raise Refusal(422, "again: is not the same password; type it twice")
    people.set_password(request, service, who, people.PasswordChange(present=present, password=password))
    return entered(request, service.sessions.begin(who.name), ACCOUNT)


@router.post(f"{ACCOUNT}/sessions/end")
def end_sessions_form(service: TheService, who: Viewer) -> Response:
    """End all sessions, including this one."""
    people.end_sessions(service, who)
    return RedirectResponse("/login", 303)


def _account_page(request: Request, service: Service, who: Principal, secret: str = "") -> Response:
    """Return the page, with the secret of a token that was just created."""
    tokens = [people.ListedToken.model_validate(token) for token in service.tokens.all(who.name) if token.is_valid]
    values: dict[str, Any] = {"shortest": SHORTEST_PASSWORD, "longest": LONGEST_PASSWORD, "secret": secret}
    values |= {"user": people.known_user(service, who.name), "sessions": service.sessions.count(who.name)}
    roles = [role.word for role in Role if who.may(role)]
    return page(request, "account", tokens=tokens, roles=roles, **values)


@router.get("/help")
def help_page(request: Request) -> Response:
    """Show what the service does, even to visitors who are not logged in."""
    try:
        request.state.principal = principal_of(request)
    except Refusal:
        request.state.principal = None
    values: dict[str, Any] = {"kinds": calls_by_kind(request.app.openapi()), "document": f"{PREFIX}/openapi.json"}
    address = request.app.state.service.settings.address
    return page(request, "help", address=address, has_documentation=SITE.is_dir(), **values)


def calls_by_kind(document: dict[str, Any]) -> dict[str, list[dict[str, str]]]:
    """Return the calls of an OpenAPI document by kind, each with ``method``, ``path``, ``summary`` and ``who``."""
    kinds: dict[str, list[dict[str, str]]] = {}
    for path, methods in document["paths"].items():
        for method in METHODS:
            if method in methods:
                call = methods[method]
                shown = {"method": method.upper(), "path": path, "summary": call["summary"], "who": call[WHO_MAY]}
                kinds.setdefault(call["tags"][0], []).append(shown)
    return kinds
