"""The list of campaigns, and what is done with one: follow, end, continue, rerun, label or delete it, report it."""

import asyncio
import base64
import json
import math
import re
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import aclosing
from typing import Annotated, Any, TypeVar

from fastapi import Header, Path, Query, Request
from pydantic import BaseModel, BeforeValidator, Field, TypeAdapter
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from campaign.coordinator.requests import cancel_campaign, delete_campaign, request_rerun
from campaign.coordinator.state import state_of, write_state
from campaign.coordinator.submit import assign_coordinator
from campaign.errors import FailedStatus, SpecError
from campaign.store.files.files import TEMPORARY
from campaign.store.labels import LabelChange, change_labels, read_labels
from campaign.store.layout import CAMPAIGN_FILE, CANCEL, POOLED
from campaign.store.store import comparisons, pools, report_folder
from clearcap.questions.pooling import pooled_folder, written_pool
from clearcap.questions.report import written_report
from clearcap.web.access import Principal
from clearcap.web.http.authentication import (
    CAMPAIGN_ID,
    Authenticated,
    Engineer,
    OtherCampaign,
    OwnCampaign,
    TheCampaign,
    TheService,
    Viewer,
    check_owner,
    is_still_valid,
    the_campaign,
)
from clearcap.web.http.responses import CountedStream, Refusal, etag_response, sendable
from clearcap.web.index import LISTED_STATES, CampaignEntry
from clearcap.web.operations import Sent
from clearcap.web.operations.submissions import check_user, place_in_queue
from clearcap.web.web_service import Service

LONGEST_CURSOR = 2000  # characters
MOST_POOLED = 50  # other campaigns
_LONGEST_WORD = 200  # characters of a text that are compared
Key = tuple[float, str]
Listed = TypeVar("Listed", bound=tuple[CampaignEntry, object])
_PLACE = TypeAdapter(tuple[str, float, str, str])  # order, key and id of the last campaign of a page


def _submitted(entry: CampaignEntry) -> Key:
    return (entry.submitted_at.timestamp() if entry.submitted_at else 0.0), ""


def _word(text: str) -> Key:
    return 0.0, text.casefold()[:_LONGEST_WORD]


ORDERS: dict[str, tuple[Callable[[CampaignEntry], Key], bool]] = {  # sort key, and whether the order is descending
    "newest": (_submitted, True),
    "oldest": (_submitted, False),
    "title": (lambda e: _word(e.title), False),
    "cpk": (lambda e: (e.weakest.cpk if e.weakest else math.inf, ""), False),
    "yield": (lambda e: (math.inf if e.share_ok is None else e.share_ok, ""), False),
    "state": (lambda e: _word(e.state), False),
    "owner": (lambda e: _word(e.owner), False),
}
MOST_LISTED = 1000


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
    state: Annotated[str | None, BeforeValidator(lambda state: state or None)] = Field(  # a form sends an empty text
        None, pattern=f"^({'|'.join(LISTED_STATES)})$"
    )
    archived: bool = Field(False, description="Include archived campaigns")
    sort: str = Field("newest", pattern=f"^({'|'.join(ORDERS)})$")


ListQuery = Annotated[ListQuestion, Query()]


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


def in_order(found: Sequence[Listed], order: str) -> list[Listed]:
    """Return campaigns sorted by one of the `ORDERS`; campaigns with equal keys are sorted by id."""
    key, falls = ORDERS[order]
    by_id = sorted(found, key=lambda each: each[0].campaign)
    return sorted(by_id, key=lambda each: key(each[0]), reverse=falls)


def cursor_after(entry: CampaignEntry, order: str) -> str:
    """Return the cursor of the page that begins after a campaign; it consists of letters, digits, ``-`` and ``_``."""
    number, word = ORDERS[order][0](entry)
    place = json.dumps([order, number, word, entry.campaign], ensure_ascii=False)
    return base64.urlsafe_b64encode(place.encode(errors="backslashreplace")).decode().rstrip("=")


def after_cursor(found: Sequence[Listed], order: str, cursor: str) -> Sequence[Listed]:
    """Return the campaigns, sorted by `order`, after a cursor of `cursor_after`; an empty one is the first page."""
    if not cursor:
        return found
    try:
        text = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True)
        given, number, word, campaign = _PLACE.validate_json(text)
        if given != order:
            raise ValueError(given)
    except ValueError as error:
        raise SpecError(
            f"cursor = {cursor!r:.60}: of no list that is sorted by {order}; begin without one, then send `next` of the"
            " answer before"
        ) from error
    key, falls = ORDERS[order]
    place = number, word

    def comes_after(entry: CampaignEntry) -> bool:
        own = key(entry)
        return entry.campaign > campaign if own == place else (own < place) == falls

    return [each for each in found if comes_after(each[0])]


async def list_campaigns(
    request: Request,
    service: TheService,
    _: Viewer,
    question: ListQuery,
    cursor: Annotated[str, Query(max_length=LONGEST_CURSOR, description="From the page before")] = "",
    limit: Annotated[int, Query(ge=1, le=MOST_LISTED)] = 100,
) -> Response:
    """List campaigns: state, progress, yield, weakest Cpk, owner and tags."""
    await service.watcher.list_first()
    found = listed(service.watcher.index.entries(), question)
    rest = after_cursor(found, question.sort, cursor)
    page = rest[:limit]
    following = f'"{cursor_after(page[-1][0], question.sort)}"' if len(rest) > limit else "null"
    rows, unread, fault = b",".join(text for _, text in page), service.watcher.index.unread, service.store_fault
    body = b'{"campaigns":[%b],"total":%d,"next":%b,"unread":%d,"fault":%b}' % (
        rows, len(found), following.encode(), unread, json.dumps(sendable(fault)).encode()
    )  # fmt: skip
    return etag_response(request, body, "application/json")


async def show_campaign(service: TheService, campaign: TheCampaign) -> CampaignEntry:
    """Show a campaign: state, progress, yield, weakest Cpk, owner and tags."""
    entry = service.watcher.index.entry(campaign)
    if entry is None:
        await service.watcher.list_campaigns(campaign)
        entry = service.watcher.index.entry(campaign)
    if entry is None:
        raise Refusal(404, f"no campaign {campaign} in the store")
    return entry


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


async def campaign_status(service: TheService, campaign: TheCampaign, who: Authenticated) -> CampaignStatus:
    """Count the rows of a campaign by status; for a running campaign, return the counts of its coordinator."""
    document = await run_in_threadpool(service.statuses.status, campaign)
    if document["heartbeat"]:
        document["heartbeat"]["token"] = ""  # the token of the coordinator's lease stays secret
        if who.campaign:  # a shared link does not show the machines
            document["heartbeat"]["by_worker"] = []
    compared = {other: where for other, where in document["comparisons"].items() if who.may_see(other)}
    return CampaignStatus(**{**document, "comparisons": compared})


class Done(BaseModel):
    """The result of a change."""

    campaign: str = Field(examples=["c60-0a1b2c3d4e"])
    before: str = Field(description="State before", examples=["running"])
    note: str = Field("", description="What happens next")


def cancel(service: TheService, campaign: OwnCampaign) -> Done:
    """End a campaign; finished rows are kept, and `resume` continues it."""
    before = cancel_campaign(service.store, campaign)
    service.watcher.hurry(campaign)
    note = "it is completed; nothing to cancel" if before == "completed" else "its workers stop within seconds"
    return Done(campaign=campaign, before=before, note=note)


async def resume(service: TheService, campaign: OwnCampaign, who: Engineer) -> Done:
    """Queue a campaign again that was cancelled or interrupted, has failed, or has lost rows."""
    async with place_in_queue(service, who, campaign):
        entry = service.watcher.index.entry(campaign)
        plan = await run_in_threadpool(service.store.plan, campaign)
        found = await run_in_threadpool(assign_coordinator, service.store, plan, [], queue_only=True)
        service.watcher.hurry(campaign)
    note = "a coordinator computes it already" if found.kind == "coordinator" else "queued"
    return Done(campaign=campaign, before=entry.state if entry else "planned", note=note)


class FailedRows(Sent):
    """The failed rows that are to be computed again."""

    statuses: list[FailedStatus] = Field(
        default=[],
        max_length=len(FailedStatus),
        description="Rows with these statuses; all failed rows if empty",
        examples=[["crashed"]],
    )


async def rerun(service: TheService, campaign: OwnCampaign, who: Engineer, wanted: FailedRows) -> Done:
    """Compute failed rows again after their cause was removed; the coordinator that serves the store does it next."""
    async with place_in_queue(service, who, campaign):
        return await run_in_threadpool(_rerun, service, campaign, who, wanted)


def _rerun(service: Service, campaign: str, who: Principal, wanted: FailedRows) -> Done:
    """Queue a campaign for its failed rows."""
    store = service.store
    before = str(state_of(store, campaign)["state"])
    if before in ("running", "queued"):
        raise Refusal(409, f"campaign {campaign} is {before}; wait for its end, or cancel it first")
    if service.signing_service.is_signed(campaign):
        raise Refusal(409, f"campaign {campaign} is signed; its rows stay as they are")
    header = store.plan_header(campaign)
    stored = store.survey(header).statuses
    count = sum(stored.get(status, 0) for status in wanted.statuses) if wanted.statuses else header.failed(stored)
    if not count:
        return Done(campaign=campaign, before=before, note="no run failed with this status; nothing to compute")
    # the request first: a coordinator may take the campaign as soon as its state is queued
    request_rerun(store, campaign, wanted.statuses, who.name)
    store.remove(campaign, CANCEL)
    write_state(store, campaign, "queued", f"{count} failed rows will be computed again")
    service.watcher.hurry(campaign)
    return Done(campaign=campaign, before=before, note=f"queued: {count} failed rows will be computed again")


class LabelRequest(Sent):
    """A change of the labels of a campaign; fields that are left out stay unchanged."""

    owner: str | None = Field(None, max_length=200, examples=["eva"])
    add_tags: list[str] = Field(default=[], max_length=50, examples=[["release-3"]])
    remove_tags: list[str] = Field(default=[], max_length=50)
    note: str | None = Field(None, max_length=5000)
    archived: bool | None = None
    version: int | None = Field(
        None, ge=0, description="`labels_version` of the entry that was read; 409 if it has changed"
    )


async def label(service: TheService, campaign: TheCampaign, who: Engineer, wanted: LabelRequest) -> CampaignEntry:
    """Change the tags and note of a campaign; its owner, and admins, also give it to another user, or archive it."""
    labels = await run_in_threadpool(read_labels, service.store, campaign)
    is_given = wanted.owner not in (None, labels.owner)
    if is_given or wanted.archived not in (None, labels.archived):
        await run_in_threadpool(check_owner, service, campaign, who)
    if is_given and wanted.owner:  # without one it is the submitter's again
        check_user(service, wanted.owner)
    change = LabelChange(wanted.owner, tuple(wanted.add_tags), tuple(wanted.remove_tags), wanted.note, wanted.archived)
    await asyncio.to_thread(change_labels, service.store, campaign, change, by=who.name, version=wanted.version)
    await service.watcher.list_campaigns(campaign)
    return await show_campaign(service, campaign)


def delete(
    service: TheService,
    campaign: OwnCampaign,
    confirm: Annotated[str, Header(alias="X-Confirm", description="The id again: rows are lost for ever")] = "",
) -> None:
    """Delete a campaign with all its rows; only its owner and admins may, and not if it is signed."""
    if confirm != campaign:
        raise Refusal(
            422, f"X-Confirm = {confirm!r:.120}: deleting removes all rows for good; to confirm, send the id {campaign}"
        )
    if service.signing_service.is_signed(campaign):
        raise Refusal(409, f"campaign {campaign} is signed; archive it instead")
    delete_campaign(service.store, campaign)
    service.watcher.index.forget(campaign)
    service.watcher.hurry(campaign)


async def follow_campaign(request: Request, service: TheService, campaign: TheCampaign, who: Authenticated) -> Response:
    """Follow a campaign by server-sent events: progress, rate, failures by status, each Cpk with its interval.

    Each `progress` event holds the whole state, so only the latest counts; with `Last-Event-ID`, that event is not sent
    again. `end` is the last event.
    """
    events = service.watcher.follow(campaign, request.headers.get("last-event-id", "")[:64])

    async def sent() -> AsyncIterator[bytes]:
        async with aclosing(events):
            async for event in events:
                if not is_still_valid(request):
                    return
                yield event

    headers = {"X-Accel-Buffering": "no"}  # keeps nginx from holding events back
    return CountedStream(service, who, sent(), "text/event-stream", headers)


async def campaign_file(request: Request, service: TheService, campaign: TheCampaign) -> Response:
    """Return the campaign file as it was submitted."""
    try:
        content = await run_in_threadpool(service.store.files.read, f"{campaign}/{CAMPAIGN_FILE}")
    except FileNotFoundError as error:
        raise Refusal(404, f"{campaign}: has no {CAMPAIGN_FILE} any more; restore it in the store") from error
    return etag_response(request, content, "application/toml")


FILE_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"


class ReportFiles(BaseModel):
    """The files of a campaign's reports."""

    files: list[str] = Field(description="Of its own report; empty if none is written", examples=[["report.html"]])
    comparisons: dict[str, list[str]] = Field(description="Of its comparisons, by the id of the other campaign")
    pools: dict[str, list[str]] = Field(
        {},
        description="Of its reports as one with other campaigns, by the part of the address that stands for these",
        examples=[{"c60-5e6f7a8b9c": ["report.html"]}],
    )


def report_files(service: TheService, campaign: TheCampaign, who: Authenticated) -> ReportFiles:
    """List the files of a campaign's report, and of its reports with other campaigns that you may see."""
    names = service.store.files.names(report_folder(campaign))
    others = comparisons(service.store, campaign)
    seen = {other: _written(files) for other, files in others.items() if who.may_see(other)}
    together = {} if who.campaign else pools(service.store, campaign)  # a shared link shows one campaign only
    return ReportFiles(
        files=_written(names), comparisons=seen, pools={pool: _written(files) for pool, files in together.items()}
    )


async def write_report(service: TheService, campaign: TheCampaign, who: Engineer) -> ReportFiles:
    """Write the report of a campaign again from the present rows; refused if the campaign is signed."""
    if service.signing_service.is_signed(campaign):
        raise Refusal(409, f"campaign {campaign} is signed, and its report with it; it is not written again")
    await service.pool.data(who.name, written_report, service.store.files.full_url, campaign)
    service.watcher.hurry(campaign)
    return await run_in_threadpool(report_files, service, campaign, who)


async def write_comparison(
    service: TheService, campaign: TheCampaign, who: Engineer, other: OtherCampaign
) -> ReportFiles:
    """Write the report that compares a campaign with another."""
    await the_campaign(service, who, other)
    await service.pool.data(who.name, written_report, service.store.files.full_url, campaign, other)
    return await run_in_threadpool(report_files, service, campaign, who)


class PoolRequest(Sent):
    """The campaigns that are one report with another one."""

    others: list[Annotated[str, Field(pattern=CAMPAIGN_ID)]] = Field(
        max_length=MOST_POOLED,
        description="Ids of campaigns that differ only in seed and number of samples",
        examples=[["c60-5e6f7a8b9c"]],
    )


class PooledReport(BaseModel):
    """The report of several campaigns as one."""

    pool: str = Field(description="Stands for the others in the address of the files", examples=["c60-5e6f7a8b9c"])
    files: list[str] = Field(examples=[["report.html"]])


async def write_pool(service: TheService, campaign: TheCampaign, who: Engineer, wanted: PoolRequest) -> PooledReport:
    """Write one report of the samples of a campaign and of others that differ only in seed and number of samples."""
    for other in wanted.others:
        await the_campaign(service, who, other)
    campaigns = [campaign, *wanted.others]
    await service.pool.data(who.name, written_pool, service.store.files.full_url, campaigns)
    folder = pooled_folder(campaigns)
    files = await run_in_threadpool(service.store.files.names, folder)
    return PooledReport(pool=folder.rpartition("/")[2], files=_written(files))


def _written(names: list[str]) -> list[str]:
    """Return the names of a report's files, without other files that may lie in its folder."""
    return [name for name in names if re.fullmatch(FILE_NAME, name) and not name.endswith(TEMPORARY)]


TYPES = {
    "html": "text/html; charset=utf-8",
    "json": "application/json",
    "parquet": "application/vnd.apache.parquet",
    "pdf": "application/pdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "svg": "image/svg+xml",
    "png": "image/png",
}


# policy of a report's page: it runs nothing, loads nothing, and only this server's pages show it in a frame
REPORT_POLICY = (
    "sandbox allow-popups; default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none';"
    " form-action 'none'; frame-ancestors 'self'"
)
FileName = Annotated[str, Path(pattern=FILE_NAME, examples=["report.html"])]
PoolName = Annotated[
    str,
    Path(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_+-]{0,199}$",
        description="`pool` of the answer that wrote it",
        examples=["c60-5e6f7a8b9c"],
    ),
]


async def report_file(request: Request, service: TheService, campaign: TheCampaign, name: FileName) -> Response:
    """Return a file of a campaign's report, whole or in parts."""
    return await file_answer(request, service, report_folder(campaign), name)


async def comparison_file(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    other: OtherCampaign,
    name: FileName,
) -> Response:
    """Return a file of a comparison, whole or in parts, to users who may see both campaigns."""
    if not who.may_see(other):
        raise Refusal(404, f"no campaign {other} in the store")
    return await file_answer(request, service, report_folder(campaign, other), name)


async def pooled_file(
    request: Request, service: TheService, campaign: TheCampaign, _: Viewer, pool: PoolName, name: FileName
) -> Response:
    """Return a file of the report of several campaigns as one, whole or in parts."""
    return await file_answer(request, service, f"{campaign}/{POOLED}/{pool}", name)


async def file_answer(request: Request, service: Service, folder: str, name: str) -> Response:
    """Return a file beside a report, whole or in parts; what is no kind of report is only for keeping."""
    kind = TYPES.get(name.rpartition(".")[2], "application/octet-stream")
    try:
        content = await run_in_threadpool(service.store.files.read, f"{folder}/{name}")
    except FileNotFoundError as error:
        raise Refusal(404, f"{folder}: has no file {name}; write the report first") from error
    frame = {"Content-Security-Policy": REPORT_POLICY, "X-Frame-Options": "SAMEORIGIN"}
    return etag_response(request, content, kind, frame)
