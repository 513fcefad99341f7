"""Who asks: the cookie of a session or a token, and whether a write comes from this server's own pages."""

import hmac
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Request, Security
from fastapi.security import APIKeyCookie, HTTPBearer

from campaign.web.access import Principal, Role
from campaign.web.access.throttle import place_of
from campaign.web.http.problems import Refusal
from campaign.web.web_service import Service

COOKIE = "__Host-clearcap"
SHARE_COOKIE = "__Host-clearcap-share"  # of its own, so that a shared link ends nobody's session
CSRF_FIELD = "csrf"
CSRF_HEADER = "x-csrf-token"
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
FORMS = "multipart/form-data", "application/x-www-form-urlencoded"

_cookie = APIKeyCookie(
    name=COOKIE, scheme_name="session", description="Cookie of a browser's session", auto_error=False
)
_bearer = HTTPBearer(scheme_name="token", description="A token, or the secret of a shared link", auto_error=False)


def service_of(request: Request) -> Service:
    """Return the service that answers."""
    service: Service = request.app.state.service
    return service


def address_of(request: Request) -> str:
    """Return the address that a request came from; behind a proxy the one that the proxy names."""
    return request.client.host if request.client else "unknown"


async def answering(request: Request) -> Service:
    """Return the service that answers, where a call needs it; no dependency takes a thread, of which there are few."""
    return service_of(request)


async def asking(request: Request, _: object = Security(_cookie), __: object = Security(_bearer)) -> Principal:
    """Return who asks.

    Raises
    ------
    Refusal
        401 without a valid session or token, 403 for a write that comes from another site, 429 after many wrong tokens.
    """
    principal = known(request)
    if not request.headers.get("authorization") and request.method not in SAFE_METHODS:
        request.state.who, request.state.how = principal.name, "a page in his name"  # of a refusal's audit entry
        check_origin(request)
        await check_form(request, principal.csrf)
    request.state.principal = principal
    return principal


def known(request: Request) -> Principal:
    """Return whose session or token a request has, before anything of its body is read.

    Raises
    ------
    Refusal
        401 without a valid session or token, 429 after many wrong tokens.
    """
    service = service_of(request)
    scheme, _, secret = request.headers.get("authorization", "").partition(" ")
    if scheme:
        principal = service.tokens.principal(secret.strip()) if scheme.lower() == "bearer" else None
        if principal is None:
            _refuse_token(service, address_of(request))
    else:
        secrets = [request.cookies[name] for name in (COOKIE, SHARE_COOKIE) if name in request.cookies]
        principal = next(filter(None, map(service.sessions.principal, secrets)), None)
    if principal is None:
        raise Refusal(
            401,
            "log in, or send a token: Authorization: Bearer clearcap_token_...",
            headers={"WWW-Authenticate": "Bearer"},
        )
    return principal


def is_still_known(request: Request) -> bool:
    """Return whether the session or token of a request whose answer goes on has not ended since."""
    try:
        known(request)
    except Refusal:
        return False
    return True


def _refuse_token(service: Service, address: str) -> None:
    """Refuse a wrong token; from an address that tried many, with 429."""
    wait = service.throttle.attempt(f"token {place_of(address)}")
    if wait:
        raise Refusal(429, f"many wrong tokens; wait {wait:.0f} s", headers={"Retry-After": f"{wait + 1:.0f}"})


def check_origin(request: Request) -> None:
    """Refuse a write by a browser that does not come from this server's own pages: 403."""
    site, origin = request.headers.get("sec-fetch-site", "same-origin"), request.headers.get("origin")
    is_own = site in ("same-origin", "none") and (origin is None or _host_of(origin) == request.headers.get("host"))
    if not is_own:
        raise Refusal(403, "this write comes from the page of another site; use this server's own pages, or a token")


def _host_of(origin: str) -> str | None:
    """Return host and port of an origin; None of ``null``, and of what no browser sends."""
    try:
        return urlsplit(origin).netloc or None
    except ValueError:
        return None


async def check_form(request: Request, csrf: str) -> None:
    """Refuse a write without the word that this session's pages send with each: 403."""
    given = request.headers.get(CSRF_HEADER)
    if given is None and request.headers.get("content-type", "").startswith(FORMS):
        given = (await request.form()).get(CSRF_FIELD)  # type: ignore[assignment]  # a file is no token
    if not isinstance(given, str) or not hmac.compare_digest(given.encode(), csrf.encode()):
        await request.close()  # files that came with the form
        raise Refusal(403, "the form is too old, or not from this server; load the page again")


def lacks_role(principal: Principal, role: Role, what: str) -> Refusal:
    """Return the refusal, 403, of what needs more than somebody's role."""
    words = f"{principal.name} has the role {principal.role.word}; {what} needs the role {role.word}: ask an admin"
    return Refusal(403, words)


@dataclass(frozen=True)
class RoleNeeded:
    """Refuse a principal with less than a role, with 403; for use with ``Depends``.

    Attributes
    ----------
    role : Role
    """

    role: Role

    async def __call__(self, principal: Annotated[Principal, Depends(asking)]) -> Principal:
        """Return the principal."""
        if not principal.may(self.role):
            raise lacks_role(principal, self.role, "this")
        return principal


async def needs_all_campaigns(principal: Annotated[Principal, Depends(asking)]) -> Principal:
    """Refuse a shared link, which shows one campaign only: 403."""
    if principal.campaign is not None:
        raise Refusal(403, f"this link shows the campaign {principal.campaign} only; log in to see more")
    return principal


Asking = Annotated[Principal, Depends(asking)]
Viewer = Annotated[Principal, Depends(needs_all_campaigns)]
Engineer = Annotated[Principal, Depends(RoleNeeded(Role.ENGINEER))]
Approver = Annotated[Principal, Depends(RoleNeeded(Role.APPROVER))]
Admin = Annotated[Principal, Depends(RoleNeeded(Role.ADMIN))]
TheService = Annotated[Service, Depends(answering)]


def who_may(calls: Iterable[object]) -> str:
    """Return in words who may do what depends on some of the calls above: for the documentation."""
    known = list(calls)
    roles = [call.role for call in known if isinstance(call, RoleNeeded)]
    if roles:
        return max(roles).word
    if needs_all_campaigns in known:
        return Role.VIEWER.word
    return f"{Role.VIEWER.word}, or a shared link" if asking in known else "anybody"
