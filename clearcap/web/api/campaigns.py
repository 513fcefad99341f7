"""Calls that list the campaigns of the store, and show the state and files of each."""

import json
from collections.abc import Iterable
from typing import Annotated, Any

from fastapi import Query, Request
from pydantic import BaseModel, Field, field_validator
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response, StreamingResponse

from campaign.store.layout import CAMPAIGN_FILE
from clearcap.web.api.calls import TheCampaign, calls
from clearcap.web.http.authentication import Asking, TheService, Viewer
from clearcap.web.http.problems import Refusal, described, sendable
from clearcap.web.http.responses import TAGGED, EventStream, tagged
from clearcap.web.watch.entry import LISTED_STATES, CampaignEntry
from clearcap.web.watch.list_order import LONGEST_CURSOR, ORDERS, after_cursor, cursor_after, in_order

router = calls("campaigns")
MOST_LISTED = 1000
_EVENT = {  # OpenAPI schema of an event in a stream
    "type": "object",
    "properties": {"event": {"enum": ["progress", "end"]}, "id": {"type": "string"}, "data": {"type": "string"}},
}


class Listing(BaseModel):
    """A page of the list of campaigns."""

    campaigns: list[CampaignEntry]
    total: int = Field(description="Campaigns that match the search", examples=[1])
    next: str | None = Field(description="Cursor of the next page; null on the last one")
    unread: int = Field(
        description="Number of campaigns in the store that have not been read and listed yet; ask again until it is 0",
        examples=[0],
    )
    fault: str = Field(description="Why the store cannot be read and the list is an earlier one; empty if it can")


class ListQuestion(BaseModel):
    """The filters and the order of a list of campaigns."""

    search: str = Field("", max_length=200, description="Part of the id, title, owner, tags, or note")
    owner: str | None = Field(None, max_length=200)
    tag: list[str] = Field(default=[], max_length=20, description="Only campaigns with all of these tags")
    state: str | None = Field(None, pattern=f"^({'|'.join(LISTED_STATES)})$")
    archived: bool = Field(False, description="Include archived campaigns")
    sort: str = Field("newest", pattern=f"^({'|'.join(ORDERS)})$")

    @field_validator("state", mode="before")
    @classmethod
    def _empty_stands_for_all(cls, value: Any) -> Any:
        """Return the state, or None for an empty text, which a form sends if none is chosen."""
        return value or None


def listed(entries: Iterable[tuple[CampaignEntry, bytes]], question: ListQuestion) -> list[tuple[CampaignEntry, bytes]]:
    """Return the entries that match a question, in its order; entries with equal keys are sorted by id."""
    words = question.search.casefold().split()
    return in_order([pair for pair in entries if _fits(pair[0], question, words)], question.sort)


def _fits(entry: CampaignEntry, question: ListQuestion, words: list[str]) -> bool:
    """Return whether an entry matches a question."""
    if entry.archived and not question.archived:
        return False
    if question.owner not in (None, entry.owner) or question.state not in (None, entry.state):
        return False
    if not set(question.tag) <= set(entry.tags):
        return False
    text = " ".join((entry.campaign, entry.title, entry.owner, *entry.tags, entry.note)).casefold() if words else ""
    return all(word in text for word in words)


@router.get("/campaigns", response_model=Listing, responses=described(*TAGGED))
async def list_campaigns(
    request: Request,
    service: TheService,
    _: Viewer,
    question: Annotated[ListQuestion, Query()],
    cursor: Annotated[str, Query(max_length=LONGEST_CURSOR, description="From the page before")] = "",
    limit: Annotated[int, Query(ge=1, le=MOST_LISTED)] = 100,
) -> Response:
    """List campaigns: state, progress, yield, weakest Cpk, owner and tags."""
    if service.watcher.listed_at is None:
        await service.watcher.list_campaigns()
    found = listed(service.watcher.index.entries(), question)
    rest = after_cursor(found, question.sort, cursor)
    page = rest[:limit]
    following = f'"{cursor_after(page[-1][0], question.sort)}"' if len(rest) > limit else "null"
    rows, unread, fault = b",".join(text for _, text in page), service.watcher.index.unread, service.store_fault
    body = b'{"campaigns":[%b],"total":%d,"next":%b,"unread":%d,"fault":%b}' % (
        rows, len(found), following.encode(), unread, json.dumps(sendable(fault)).encode()
    )  # fmt: skip
    return tagged(request, body, "application/json")


@router.get("/campaigns/{campaign}", responses=described(404))
async def show_campaign(service: TheService, campaign: TheCampaign) -> CampaignEntry:
    """Show a campaign: state, progress, yield, weakest Cpk, owner and tags."""
    entry = service.watcher.index.entry(campaign)
    if entry is None:
        await service.watcher.list_campaigns(campaign)
        entry = service.watcher.index.entry(campaign)
    if entry is None:
        raise Refusal(404, f"no campaign {campaign} in the store")
    return entry


@router.get(
    "/campaigns/{campaign}/events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {"schema": _EVENT}}}, **described(404)},
)
async def follow_campaign(request: Request, service: TheService, campaign: TheCampaign, who: Asking) -> Response:
    """Follow a campaign by server-sent events: progress, rate, failures by status, each Cpk with its interval.

    Each `progress` event holds the whole state, so only the latest counts; with `Last-Event-ID`, that event is not sent
    again. `end` is the last event.
    """
    limit = service.settings.limits.streams
    if service.streams[who.name] >= limit:
        raise Refusal(429, f"{who.name} has {limit} event streams open; close one", headers={"Retry-After": "5"})
    events = service.watcher.follow(campaign, request.headers.get("last-event-id", "")[:64])
    return EventStream(request, events, service.streams, who.name)


@router.get(
    "/campaigns/{campaign}/campaign.toml",
    response_class=Response,
    responses={200: {"content": {"application/toml": {"schema": {"type": "string"}}}}, **described(*TAGGED, 404)},
)
async def campaign_file(request: Request, service: TheService, campaign: TheCampaign) -> Response:
    """Return the campaign file as it was submitted."""
    try:
        content = await run_in_threadpool(service.store.files.read, f"{campaign}/{CAMPAIGN_FILE}")
    except FileNotFoundError as error:
        raise Refusal(404, f"{campaign}: has no {CAMPAIGN_FILE} any more; restore it in the store") from error
    return tagged(request, content, "application/toml")


class CampaignStatus(BaseModel):
    """The progress of a campaign."""

    campaign: str = Field(examples=["c60-0a1b2c3d4e"])
    store: str = Field(description="Where its files are", examples=["runs"])
    state: str = Field(examples=["running"])
    message: str = Field("", description="Details of the state")
    since: str | None = Field(description="When the state began, ISO 8601", examples=["2026-11-23T09:00:00+00:00"])
    open: bool = Field(description="A coordinator that serves the store would continue it")
    fault: str | None = Field(description="What is wrong with the file of its state", examples=[None])
    samples: int = Field(examples=[30850])
    done: int = Field(description="Rows that are stored", examples=[12000])
    ok: int = Field(examples=[11998])
    failed: int = Field(examples=[2])
    left: int = Field(examples=[18850])
    statuses: dict[str, int] = Field(description="Rows by status", examples=[{"ok": 11998, "not_at_rest": 2}])
    repeats: int = Field(description="Samples that are to be repeated with half the step")
    repeated: int
    heartbeat: dict[str, Any] | None = Field(description="Of a campaign that runs: rate, time to go, each Cpk so far")
    waits_for: str = Field(description="What a running campaign waits for", examples=["no workers for 40 s"])
    comparisons: dict[str, str] = Field(description="Where its comparisons are, by the id of the other campaign")
    remarks: list[str] = Field(description="What is wrong with its files", examples=[[]])


@router.get("/campaigns/{campaign}/status", responses=described(404))
async def campaign_status(service: TheService, campaign: TheCampaign, who: Asking) -> CampaignStatus:
    """Count the rows of a campaign by status; for a running campaign, return the counts of its coordinator."""
    document = await run_in_threadpool(service.statuses.status, campaign)
    if document["heartbeat"]:
        document["heartbeat"]["token"] = ""  # the token of the coordinator's lease stays secret
    compared = {other: where for other, where in document["comparisons"].items() if who.may_see(other)}
    return CampaignStatus(**{**document, "comparisons": compared})
