"""Calls for shared links; anyone who has a link can see its campaign until it expires or is revoked."""

from datetime import UTC, datetime
from typing import Annotated

from fastapi import Path, Query, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from clearcap.web.access import Principal
from clearcap.web.access.credentials import SharedLink
from clearcap.web.api.calls import TheCampaign, calls
from clearcap.web.api.users import DAY
from clearcap.web.http.authentication import Engineer, TheService
from clearcap.web.http.problems import Refusal, described
from clearcap.web.web_service import Service

router = calls("shares")
MOST_SHARES = 200  # valid links of a campaign


class ListedShare(BaseModel):
    """A shared link, without its secret."""

    id: int = Field(examples=[1])
    campaign: str = Field(examples=["c60-0a1b2c3d4e"])
    by: str = Field(description="Who shared it", examples=["eva"])
    note: str = Field(description="For whom", examples=["the customer's review"])
    created: datetime = Field(examples=["2026-11-23T09:00:00Z"])
    expires: datetime = Field(examples=["2026-12-07T09:00:00Z"])
    revoked: datetime | None = Field(examples=[None])
    is_valid: bool = Field(description="It has neither expired nor been revoked", examples=[True])

    @classmethod
    def of(cls, share: SharedLink) -> "ListedShare":
        """Return the listed form of a link."""
        times = {name: getattr(share, name) for name in ("created", "expires", "revoked")}
        dates = {name: None if at is None else datetime.fromtimestamp(at, UTC) for name, at in times.items()}
        return cls.model_validate({**vars(share), **dates, "is_valid": share.is_valid})


class ShareList(BaseModel):
    """A page of the shared links of a campaign, newest first."""

    shares: list[ListedShare]
    next: int | None = Field(description="Cursor of the next page; null on the last one", examples=[None])


class NewShare(BaseModel):
    """A link to be created."""

    model_config = ConfigDict(extra="forbid")
    days: int = Field(14, ge=1, le=90, description="For how long it is valid", examples=[14])
    note: str = Field("", max_length=200, description="For whom", examples=["the customer's review"])


class MadeShare(BaseModel):
    """A link that was just created."""

    share: ListedShare
    link: str = Field(description="Shown this once", examples=["https://clearcap.example/shared/clearcap_share_..."])


@router.get("/campaigns/{campaign}/shares", responses=described(404))
def list_shares(
    service: TheService,
    campaign: TheCampaign,
    _: Engineer,
    cursor: Annotated[int | None, Query(ge=0, le=2**53, description="From the page before")] = None,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> ShareList:
    """List the shared links to a campaign, newest first."""
    rest = [share for share in service.tokens.shares(campaign) if cursor is None or share.id < cursor]
    following = rest[limit - 1].id if len(rest) > limit else None
    return ShareList(shares=[ListedShare.of(share) for share in rest[:limit]], next=following)


@router.post("/campaigns/{campaign}/shares", status_code=201, responses=described(404, 409))
def add_share(request: Request, service: TheService, campaign: TheCampaign, who: Engineer, new: NewShare) -> MadeShare:
    """Create a link that lets anyone see this campaign, read-only."""
    return shared(request, service, campaign, who, new)


def shared(request: Request, service: Service, campaign: str, who: Principal, new: NewShare) -> MadeShare:
    """Create a link to a campaign; raise Refusal (409) if it has too many."""
    if sum(share.is_valid for share in service.tokens.shares(campaign)) >= MOST_SHARES:
        raise Refusal(409, f"{campaign} has {MOST_SHARES} links; revoke one first")
    share, secret = service.tokens.share(campaign, who.name, new.note, new.days * DAY)
    request.state.detail = f"share {share.id}, {new.days} days"
    return MadeShare(share=ListedShare.of(share), link=f"{service.settings.address}/shared/{secret}")


@router.delete(
    "/campaigns/{campaign}/shares/{share}", status_code=204, response_class=Response, responses=described(404)
)
def revoke_share(
    service: TheService,
    campaign: TheCampaign,
    _: Engineer,
    share: Annotated[int, Path(ge=0, le=2**53, examples=[1])],
) -> Response:
    """Revoke a link, and end the sessions that were begun with it."""
    end_share(service, campaign, share)
    return Response(status_code=204)


def end_share(service: Service, campaign: str, share: int) -> None:
    """Revoke a link; raise Refusal (404) if the campaign has no link of this number."""
    if not service.tokens.revoke_share(campaign, share):
        raise Refusal(404, f"no link {share} to {campaign}")
