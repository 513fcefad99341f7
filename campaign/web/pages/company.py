"""Login with a company account: to the company's login service, and back."""

from fastapi import APIRouter, Request
from starlette.responses import RedirectResponse, Response

from campaign.web.access.company_login import LOGIN_WITHIN, CompanyLogin, LoginFault, company_user
from campaign.web.access.throttle import place_of
from campaign.web.http.asking import TheService, address_of
from campaign.web.http.problems import Refusal
from campaign.web.pages.login import HOME, entered, own_path
from campaign.web.web_service import Service

router = APIRouter(include_in_schema=False)
BEGUN = "__Host-clearcap-login"  # cookie of a login in progress


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
