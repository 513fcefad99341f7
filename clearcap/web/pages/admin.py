"""The pages for admins: users, tokens, audit trail, queue and workers, health, limits."""

import time
from dataclasses import asdict
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Form, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import StoreError
from clearcap.web.access import Role
from clearcap.web.access.users import LONGEST_PASSWORD, NAME, SHORTEST_PASSWORD
from clearcap.web.http.authentication import Admin, TheService
from clearcap.web.operations import people, signoffs
from clearcap.web.pages.rendering import Flag, NewPassword, QueryText, page
from clearcap.web.watcher import look_at_work
from clearcap.web.web_service import Service

router = APIRouter(include_in_schema=False)
ADMIN = "/admin"
ON_A_PAGE = 100
CHECKED_AT_ONCE = 10_000  # an audit trail of up to this many entries is checked whenever it is shown


@router.get(ADMIN)
def users_page(request: Request, service: TheService, who: Admin, cursor: QueryText = "") -> Response:
    """Show the users and their roles."""
    return _users_page(request, service, who.name, cursor)


@router.post(f"{ADMIN}/users")
def add_user_form(
    request: Request,
    service: TheService,
    who: Admin,
    name: Annotated[str, Form(pattern=f"^{NAME.pattern}$")],
    role: Annotated[people.RoleWord, Form()],
) -> Response:
    """Add a user, and show the link for their first login."""
    people.add_user(request, service, who, people.NewUser(name=name, role=role))
    return _users_page(request, service, who.name, link_of=name, link=people.make_login_link(service, who, name))


@router.post(f"{ADMIN}/users/{{name}}/role")
def role_form(
    request: Request, service: TheService, who: Admin, name: people.UserName, role: Annotated[people.RoleWord, Form()]
) -> Response:
    """Change the role of a user."""
    people.change_user(request, service, who, name, people.UserChange(role=role))
    return RedirectResponse(ADMIN, 303)


@router.post(f"{ADMIN}/users/{{name}}/disabled")
def disabled_form(
    request: Request, service: TheService, who: Admin, name: people.UserName, disabled: Annotated[bool, Form()]
) -> Response:
    """Disable a user, or enable them again."""
    people.change_user(request, service, who, name, people.UserChange(disabled=disabled))
    return RedirectResponse(ADMIN, 303)


@router.post(f"{ADMIN}/users/{{name}}/access")
def end_access_form(service: TheService, who: Admin, name: people.UserName) -> Response:
    """End all sessions, tokens, shared links and webhooks of a user."""
    people.end_access(service, who, name)
    return RedirectResponse(ADMIN, 303)


@router.post(f"{ADMIN}/users/{{name}}/password")
def set_password_form(
    request: Request, service: TheService, who: Admin, name: people.UserName, password: NewPassword
) -> Response:
    """Set the password of a user."""
    people.change_user(request, service, who, name, people.UserChange(password=password))
    return RedirectResponse(ADMIN, 303)


@router.post(f"{ADMIN}/users/{{name}}/link")
def link_form(request: Request, service: TheService, who: Admin, name: people.UserName) -> Response:
    """Create a one-time login link for a user, and show it this once."""
    link = people.make_login_link(service, who, name)
    return _users_page(request, service, who.name, link_of=name, link=link)


@router.get(f"{ADMIN}/tokens")
def tokens_page(request: Request, service: TheService, who: Admin, cursor: people.Cursor = None) -> Response:
    """Show the tokens of all users."""
    return page(request, "admin_tokens", listing=people.list_tokens(service, who, True, cursor, ON_A_PAGE))


@router.post(f"{ADMIN}/tokens/{{token}}/revoke")
def revoke_token_form(service: TheService, who: Admin, token: people.ListedId) -> Response:
    """Revoke a token of any user."""
    people.revoke_token(service, who, token)
    return RedirectResponse(f"{ADMIN}/tokens", 303)


@router.get(f"{ADMIN}/audit")
def audit_page(
    request: Request,
    service: TheService,
    admin: Admin,
    object: Annotated[str, Query(max_length=200)] = "",
    who: QueryText = "",
    cursor: people.Cursor = None,
    check: Flag = False,
) -> Response:
    """Show the audit trail, and whether it is intact."""
    listing = people.list_audit(service, admin, object, who, cursor, ON_A_PAGE)
    newest = service.audit.newest(count=1)
    is_checked = check or not newest or newest[0].number <= CHECKED_AT_ONCE
    wholeness = people.check_audit(service, admin) if is_checked else None
    further = f"object={quote(object)}&who={quote(who)}&cursor={listing.next}" if listing.next else ""
    values: dict[str, Any] = {"listing": listing, "object": object, "who": who, "wholeness": wholeness}
    return page(request, "admin_audit", further=further, **values)


@router.get(f"{ADMIN}/system")
async def system_page(request: Request, service: TheService, who: Admin) -> Response:
    """Show the running and waiting campaigns, health, limits, and the key of sign-offs."""
    settings, watcher, fault = service.settings, service.watcher, ""
    try:
        await watcher.list_first()
        known = [entry for entry, _ in watcher.index.entries()]
        service.workload = await run_in_threadpool(look_at_work, service.store, known, service.workload)
    except StoreError as error:
        fault = str(error)
    entries = [entry for entry, _ in watcher.index.entries()]
    values: dict[str, Any] = {
        **{"coordinate": settings.coordinate, "processes": settings.processes, "limits": asdict(settings.limits)},
        **{"store": service.store.url, "fault": fault or service.store_fault, "free": service.free_space()},
        **{"jobs": service.pool.turns.by_user, "followers": watcher.followers, "campaigns": len(entries)},
        "work": None if fault else service.workload,
        "listed_s": None if watcher.listed_at is None else time.monotonic() - watcher.listed_at,
        "broken": sorted(entry.campaign for entry in entries if entry.state == "broken"),
        "database": service.database.path.stat().st_size,
        "issuer": settings.oidc.issuer if settings.oidc else "",
        "key": signoffs.show_signing_key(service, who).fingerprint,
    }
    return page(request, "admin_system", **values)


def _users_page(
    request: Request,
    service: Service,
    own_name: str,
    cursor: str = "",
    link_of: str = "",
    link: people.LoginLink | None = None,
) -> Response:
    """Return the page of the users, with a login link that was just created."""
    listing = people.list_users(service, request.state.principal, cursor, ON_A_PAGE)
    values: dict[str, Any] = {"listing": listing, "roles": [role.word for role in Role], "own_name": own_name}
    values |= {"link_of": link_of, "link": link, "shortest": SHORTEST_PASSWORD, "longest": LONGEST_PASSWORD}
    return page(request, "admin", **values)
