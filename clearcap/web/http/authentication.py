"""Authentication of requests by cookie, token or password, and checks that writes come from this server's own pages."""

import hmac
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Path, Request, Security
from fastapi.security import APIKeyCookie, HTTPBearer
from starlette.concurrency import run_in_threadpool

from campaign.store.labels import read_labels
from campaign.store.layout import PLAN
from clearcap.web.access import Principal, Role
from clearcap.web.access.throttle import place_of
from clearcap.web.access.users import User
from clearcap.web.http.responses import Refusal
from clearcap.web.web_service import Service

CAMPAIGN_ID = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,99}$"
WHO_MAY = "x-who-may"  # key of a call in the OpenAPI document
COOKIE = "__Host-clearcap"
SHARE_COOKIE = "__Host-clearcap-share"  # a separate cookie, so that opening a shared link ends nobody's session
CSRF_FIELD = "csrf"
CSRF_HEADER = "x-csrf-token"
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
FORMS = "multipart/form-data", "application/x-www-form-urlencoded"
_cookie = APIKeyCookie(
    name=COOKIE, scheme_name="session", description="Cookie of a browser's session", auto_error=False
)
_bearer = HTTPBearer(scheme_name="token", description="A token, or the secret of a shared link", auto_error=False)


def service_of(request: Request) -> Service:
    """Return the service that answers a request."""
    service: Service = request.app.state.service
    return service


def address_of(request: Request) -> str:
    """Return the client address of a request; behind a proxy, the one that the proxy reports."""
    return request.client.host if request.client else "unknown"


async def the_service(request: Request) -> Service:
    """Return the service, as a dependency of a call; it is async, because others would take one of the few threads."""
    return service_of(request)


async def authenticated(request: Request, _: object = Security(_cookie), __: object = Security(_bearer)) -> Principal:
    """Return the principal of a request, as a dependency of a call; or refuse it (401, 403, 429)."""
    principal = principal_of(request)
    # only cookies are sent by a browser on its own, so only they need protection against forged requests
    if not request.headers.get("authorization") and request.method not in SAFE_METHODS:
        request.state.who, request.state.how = principal.name, "a page in their name"  # to audit a refusal
        check_origin(request)
        await check_form(request, principal.csrf)
    request.state.principal = principal
    return principal


def principal_of(request: Request) -> Principal:
    """Return the principal of a request's session or token, without reading the body."""
    service = service_of(request)
    scheme, _, secret = request.headers.get("authorization", "").partition(" ")
    if scheme:
        principal = service.tokens.principal(secret.strip()) if scheme.lower() == "bearer" else None
        if principal is None and (wait := service.throttle.attempt(f"token {place_of(address_of(request))}")):
            raise Refusal(429, f"many wrong tokens; wait {wait:.0f} s", headers={"Retry-After": f"{wait + 1:.0f}"})
    else:
        # the user's own session first: who is logged in stays so after opening a shared link
        secrets = [request.cookies[name] for name in (COOKIE, SHARE_COOKIE) if name in request.cookies]
        principal = next(filter(None, map(service.sessions.principal, secrets)), None)
    if principal is None:
        words = "log in, or send a token: Authorization: Bearer clearcap_token_..."
        raise Refusal(401, words, headers={"WWW-Authenticate": "Bearer"})
    return principal


def is_still_valid(request: Request) -> bool:
    """Return whether the session or token of a request is still valid, for an answer that lasts long."""
    try:
        principal_of(request)
    except Refusal:
        return False
    return True


def check_origin(request: Request) -> None:
    """Refuse with 403 a browser's write that does not come from this server's own pages."""
    # old browsers and programs send neither header; for them the CSRF token of `check_form` alone must suffice
    site, origin = request.headers.get("sec-fetch-site", "same-origin"), request.headers.get("origin")
    is_own = site in ("same-origin", "none") and (origin is None or _host_of(origin) == request.headers.get("host"))
    if not is_own:
        raise Refusal(403, "this write comes from the page of another site; use this server's own pages, or a token")


def _host_of(origin: str) -> str | None:
    """Return the host and port of an origin; None for ``null`` and for invalid origins, which no browser sends."""
    try:
        return urlsplit(origin).netloc or None
    except ValueError:
        return None


async def check_form(request: Request, csrf: str) -> None:
    """Refuse with 403 a write without the CSRF token of its session."""
    given = request.headers.get(CSRF_HEADER)
    if given is None and request.headers.get("content-type", "").startswith(FORMS):
        given = (await request.form()).get(CSRF_FIELD)  # type: ignore[assignment]  # a file is no token
    if not isinstance(given, str) or not hmac.compare_digest(given.encode(), csrf.encode()):
        await request.close()  # closes the files that came with the form
        raise Refusal(403, "the form is too old, or not from this server; load the page again")


def lacks_role(principal: Principal, role: Role, what: str) -> Refusal:
    """Return the refusal, with 403, of a principal whose role is too low for `what`."""
    words = f"{principal.name} has the role {principal.role.word}; {what} needs the role {role.word}: ask an admin"
    return Refusal(403, words)


@dataclass(frozen=True)
class RoleNeeded:
    """A dependency that refuses, with 403, principals below a role; for use with ``Depends``."""

    role: Role

    async def __call__(self, principal: Annotated[Principal, Depends(authenticated)]) -> Principal:
        """Return the principal if their role suffices."""
        if not principal.may(self.role):
            raise lacks_role(principal, self.role, "this")
        return principal


async def needs_all_campaigns(principal: Annotated[Principal, Depends(authenticated)]) -> Principal:
    """Return the principal; refuse a shared link with 403, because it shows one campaign only."""
    if principal.campaign is not None:
        raise Refusal(403, f"this link shows the campaign {principal.campaign} only; log in to see more")
    return principal


Authenticated = Annotated[Principal, Depends(authenticated)]
Viewer = Annotated[Principal, Depends(needs_all_campaigns)]
Engineer = Annotated[Principal, Depends(RoleNeeded(Role.ENGINEER))]
Approver = Annotated[Principal, Depends(RoleNeeded(Role.APPROVER))]
Admin = Annotated[Principal, Depends(RoleNeeded(Role.ADMIN))]
TheService = Annotated[Service, Depends(the_service)]


def checked_user(request: Request, name: str, password: str) -> User | None:
    """Return the user with a name and a password; None if the password is wrong or there is no such user."""
    service = service_of(request)
    address = address_of(request)
    if wait := service.logins.attempt(name, address):
        headers = {"Retry-After": f"{wait + 1:.0f}"}
        raise Refusal(429, f"too many failed logins; wait {wait:.0f} s and try again", headers=headers)
    try:
        user = service.users.by_password(name, password)
    except TimeoutError as error:
        service.logins.take_back(name, address)
        raise Refusal(503, "many log in now; try again in some seconds", headers={"Retry-After": "5"}) from error
    if user is not None:
        service.logins.succeeded(name, address)
    return user


async def the_campaign(
    service: TheService,
    principal: Authenticated,
    campaign: Annotated[str, Path(pattern=CAMPAIGN_ID, description="Id of the campaign", examples=["c60-0a1b2c3d4e"])],
) -> str:
    """Return a campaign that the principal may see; 404 also for others, so that nobody learns which there are."""
    if principal.may_see(campaign):
        is_known = service.watcher.index.entry(campaign) is not None
        if is_known or await run_in_threadpool(service.store.files.exists, f"{campaign}/{PLAN}"):
            return campaign
    raise Refusal(404, f"no campaign {campaign} in the store")


TheCampaign = Annotated[str, Depends(the_campaign)]


def owner_of(service: Service, campaign: str) -> str:
    """Return the user whose campaign it is: who submitted it, until it was given to another; empty if not known."""
    return read_labels(service.store, campaign).owner or service.signing_service.submitter(campaign)


def check_owner(service: Service, campaign: str, who: Principal) -> None:
    """Refuse (403) a change of a campaign by anybody but its owner and admins."""
    owner = owner_of(service, campaign)
    if not who.may(Role.ADMIN) and owner != who.name:
        raise Refusal(403, f"campaign {campaign} is {owner or 'nobody'}'s; only its owner and admins may change it")


async def the_own_campaign(service: TheService, campaign: TheCampaign, who: Engineer) -> str:
    """Return the id of a campaign after checking that the principal owns it, or is an admin."""
    await run_in_threadpool(check_owner, service, campaign, who)
    return campaign


OwnCampaign = Annotated[str, Depends(the_own_campaign)]
OtherCampaign = Annotated[
    str, Path(pattern=CAMPAIGN_ID, description="Id of the other campaign", examples=["c60-5e6f7a8b9c"])
]


def who_may(calls: Iterable[object]) -> str:
    """Describe who may use a call with some of the dependencies above, for the API documentation."""
    known = list(calls)
    if the_own_campaign in known:
        return "owner, or admin"
    roles = [call.role for call in known if isinstance(call, RoleNeeded)]
    if roles:
        return max(roles).word
    if needs_all_campaigns in known:
        return Role.VIEWER.word
    return f"{Role.VIEWER.word}, or a shared link" if authenticated in known else "anybody"
