"""Calls that change a campaign: end, continue, rerun, label or delete it."""

import asyncio
from typing import Annotated

from fastapi import Header
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from campaign.coordinator.requests import cancel_campaign, delete_campaign, request_rerun
from campaign.coordinator.state import state_of, write_state
from campaign.coordinator.submit import assign_coordinator
from campaign.run_status import FailedStatus
from campaign.store.labels import LabelChange, change_labels
from campaign.store.layout import CANCEL
from clearcap.web.access import Role
from clearcap.web.api.calls import TheCampaign, calls
from clearcap.web.http.authentication import Engineer, TheService
from clearcap.web.http.problems import Refusal, described
from clearcap.web.watch.entry import CampaignEntry

router = calls("campaigns")


class Done(BaseModel):
    """The result of a change."""

    campaign: str = Field(examples=["c60-0a1b2c3d4e"])
    before: str = Field(description="State before", examples=["running"])
    note: str = Field("", description="What happens next")


@router.post("/campaigns/{campaign}/cancel", responses=described(404))
def cancel(service: TheService, campaign: TheCampaign, _: Engineer) -> Done:
    """End a campaign; finished rows are kept, and `resume` continues it."""
    before = cancel_campaign(service.store, campaign)
    service.watcher.hurry(campaign)
    note = "it is completed; nothing to cancel" if before == "completed" else "its workers stop within seconds"
    return Done(campaign=campaign, before=before, note=note)


@router.post("/campaigns/{campaign}/resume", responses=described(404))
def resume(service: TheService, campaign: TheCampaign, _: Engineer) -> Done:
    """Queue a campaign again that was cancelled or interrupted, has failed, or has lost rows."""
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


@router.post("/campaigns/{campaign}/rerun", responses=described(404, 409))
def rerun(service: TheService, campaign: TheCampaign, who: Engineer, wanted: FailedRows) -> Done:
    """Compute failed rows again after their cause was removed; the coordinator that serves the store does it next."""
    store = service.store
    before = str(state_of(store, campaign)["state"])
    if before in ("running", "queued"):
        raise Refusal(409, f"campaign {campaign} is {before}; wait for its end, or cancel it first")
    failed = {status: n for status, n in store.survey(store.plan_header(campaign)).statuses.items() if status != "ok"}
    count = sum(n for status, n in failed.items() if not wanted.statuses or status in wanted.statuses)
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


@router.patch("/campaigns/{campaign}/labels", responses=described(404, 409))
async def label(service: TheService, campaign: TheCampaign, who: Engineer, wanted: LabelRequest) -> CampaignEntry:
    """Change the owner, tags and note of a campaign, or archive it."""
    change = LabelChange(wanted.owner, tuple(wanted.add_tags), tuple(wanted.remove_tags), wanted.note, wanted.archived)
    await asyncio.to_thread(change_labels, service.store, campaign, change, by=who.name, version=wanted.version)
    await service.watcher.list_campaigns(campaign)
    entry = service.watcher.index.entry(campaign)
    if entry is None:
        raise Refusal(404, f"no campaign {campaign} in the store")
    return entry


@router.delete("/campaigns/{campaign}", status_code=204, responses=described(404, 409), response_class=Response)
def delete(
    service: TheService,
    campaign: TheCampaign,
    who: Engineer,
    confirm: Annotated[str, Header(alias="X-Confirm", description="The id again: rows are lost for ever")] = "",
) -> Response:
    """Delete a campaign with all its rows; only its owner and admins may, and not if it is signed."""
    entry = service.watcher.index.entry(campaign)
    owner = entry.owner or entry.submitted_by if entry else ""
    if not who.may(Role.ADMIN) and owner != who.name:
        raise Refusal(403, f"campaign {campaign} is {owner or 'nobody'}'s; its owner or an admin may delete it")
    if confirm != campaign:
        raise Refusal(
            422, f"X-Confirm = {confirm!r:.120}: deleting removes all rows for good; to confirm, send the id {campaign}"
        )
    if service.is_signed(campaign):
        raise Refusal(409, f"campaign {campaign} is signed; archive it instead")
    delete_campaign(service.store, campaign)
    service.watcher.index.forget(campaign)
    service.watcher.hurry(campaign)
    return Response(status_code=204)
