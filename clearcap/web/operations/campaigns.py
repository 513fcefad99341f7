"""What is done with one campaign: show it, end, continue, rerun, label or delete it, write its reports."""

import asyncio
import re
from typing import Annotated, Any

from fastapi import Header
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from campaign.coordinator.requests import cancel_campaign, delete_campaign, request_rerun
from campaign.coordinator.state import state_of, write_state
from campaign.coordinator.submit import assign_coordinator
from campaign.errors import FailedStatus
from campaign.store.files.files import TEMPORARY
from campaign.store.labels import LabelChange, change_labels, read_labels
from campaign.store.layout import CANCEL
from campaign.store.store import comparisons, report_folder
from clearcap.questions.report import written_report
from clearcap.web.access import Principal
from clearcap.web.http.authentication import (
    Authenticated,
    Engineer,
    OtherCampaign,
    OwnCampaign,
    TheCampaign,
    TheService,
    check_owner,
    the_campaign,
)
from clearcap.web.http.problems import Refusal
from clearcap.web.operations.submissions import check_user, place_in_queue
from clearcap.web.watch.entry import CampaignEntry
from clearcap.web.web_service import Service


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
        return await run_in_threadpool(_resume, service, campaign)


def _resume(service: Service, campaign: str) -> Done:
    """Queue a campaign again."""
    entry = service.watcher.index.entry(campaign)
    plan = service.store.plan(campaign)
    assignment = assign_coordinator(service.store, plan, [], queue_only=True)
    service.watcher.hurry(campaign)
    note = "a coordinator computes it already" if assignment.kind == "coordinator" else "queued"
    return Done(campaign=campaign, before=entry.state if entry else "planned", note=note)


class FailedRows(BaseModel):
    """The failed rows that are to be computed again."""

    model_config = ConfigDict(extra="forbid")
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
    if service.is_signed(campaign):
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


class LabelRequest(BaseModel):
    """A change of the labels of a campaign; fields that are left out stay unchanged."""

    model_config = ConfigDict(extra="forbid")
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
    entry = service.watcher.index.entry(campaign)
    if entry is None:
        raise Refusal(404, f"no campaign {campaign} in the store")
    return entry


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
    if service.is_signed(campaign):
        raise Refusal(409, f"campaign {campaign} is signed; archive it instead")
    delete_campaign(service.store, campaign)
    service.watcher.index.forget(campaign)
    service.watcher.hurry(campaign)


FILE_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"


class ReportFiles(BaseModel):
    """The files of a campaign's reports."""

    files: list[str] = Field(description="Of its own report; empty if none is written", examples=[["report.html"]])
    comparisons: dict[str, list[str]] = Field(description="Of its comparisons, by the id of the other campaign")


def report_files(service: TheService, campaign: TheCampaign, who: Authenticated) -> ReportFiles:
    """List the files of a campaign's report and of its comparisons with campaigns that you may see."""
    names = service.store.files.names(report_folder(campaign))
    others = comparisons(service.store, campaign)
    seen = {other: _written(files) for other, files in others.items() if who.may_see(other)}
    return ReportFiles(files=_written(names), comparisons=seen)


async def write_report(service: TheService, campaign: TheCampaign, who: Engineer) -> ReportFiles:
    """Write the report of a campaign again from the present rows; refused if the campaign is signed."""
    if service.is_signed(campaign):
        raise Refusal(409, f"campaign {campaign} is signed, and its report with it; it is not written again")
    await service.pool.data(who.name, written_report, service.store.files.full_url, campaign)
    service.watcher.hurry(campaign)
    return await run_in_threadpool(report_files, service, campaign, who)


async def write_comparison(
    service: TheService,
    campaign: TheCampaign,
    who: Engineer,
    other: OtherCampaign,
) -> ReportFiles:
    """Write the report that compares a campaign with another."""
    await the_campaign(service, who, other)
    await service.pool.data(who.name, written_report, service.store.files.full_url, campaign, other)
    return await run_in_threadpool(report_files, service, campaign, who)


def _written(names: list[str]) -> list[str]:
    """Return the names of a report's files, without other files that may lie in its folder."""
    return [name for name in names if re.fullmatch(FILE_NAME, name) and not name.endswith(TEMPORARY)]
