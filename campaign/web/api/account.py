"""Calls for a user's own account: password and sessions."""

from fastapi import Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from campaign.web.access import Principal
from campaign.web.api.calls import calls
from campaign.web.api.tokens import needs_session
from campaign.web.api.users import ListedUser, Password, known_user
from campaign.web.http.asking import TheService, Viewer
from campaign.web.http.password_login import checked_user
from campaign.web.http.problems import Refusal
from campaign.web.web_service import Service

router = calls("account")


class PasswordChange(BaseModel):
    """A new password, and the one that it replaces."""

    model_config = ConfigDict(extra="forbid")
    present: str | None = Field(None, max_length=2000, description="Not needed if you have none yet")
    password: Password


@router.get("/account")
def show_account(service: TheService, who: Viewer) -> ListedUser:
    """Show who you are."""
    return ListedUser.of(known_user(service, who.name))


@router.put("/account/password", status_code=204, response_class=Response)
def set_password(request: Request, service: TheService, who: Viewer, change: PasswordChange) -> Response:
    """Change your password; all your sessions end, including this one."""
    change_password(request, service, who, change.present or "", change.password)
    return Response(status_code=204)


@router.delete("/account/sessions", status_code=204, response_class=Response)
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
