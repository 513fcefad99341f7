"""Password login with a throttle on guessing."""

from fastapi import Request

from campaign.web.access.throttle import place_of
from campaign.web.access.users import User
from campaign.web.http.asking import address_of, service_of
from campaign.web.http.problems import Refusal


def checked_user(request: Request, name: str, password: str) -> User | None:
    """Return the user with a name and a password; None if the password is wrong or there is no such user.

    The refusal is 429 after many failures for this name or from this address, 503 if too many passwords are being
    checked.
    """
    service = service_of(request)
    by_name, by_address = f"name {name}", f"address {place_of(address_of(request))}"
    if wait := service.throttle.attempt(by_name, by_address):
        headers = {"Retry-After": f"{wait + 1:.0f}"}
        raise Refusal(429, f"too many failed logins; wait {wait:.0f} s and try again", headers=headers)
    try:
        user = service.users.by_password(name, password)
    except TimeoutError as error:
        service.throttle.take_back(by_name, by_address)
        raise Refusal(503, "many log in now; try again in some seconds", headers={"Retry-After": "5"}) from error
    if user is not None:
        # only this attempt: somebody with one valid password must not clear the failures of their guesses at others
        service.throttle.take_back(by_address)
        service.throttle.succeeded(by_name)
    return user
