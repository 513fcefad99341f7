"""The list of campaigns, and the pages of each: progress, report and actions; shared links; sign-offs."""

import json
import time
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Form, Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.coordinator.heartbeat import observe
from campaign.errors import CampaignError, StoreError
from clearcap.questions.pooling import possible_members
from clearcap.questions.signing import LONGEST_COMMENT
from clearcap.web.access import Principal, Role
from clearcap.web.http.authentication import (
    CAMPAIGN_ID,
    Approver,
    Authenticated,
    Engineer,
    OwnCampaign,
    TheCampaign,
    TheService,
    Viewer,
    owner_of,
)
from clearcap.web.jobs import queries
from clearcap.web.jobs.pool import Busy
from clearcap.web.operations import campaigns, people, signoffs, submissions
from clearcap.web.pages.histograms import histogram_figure
from clearcap.web.pages.rendering import Flag, or_fault, page
from clearcap.web.watcher import PRELIMINARY, preliminary_interval, progress_of
from clearcap.web.web_service import Service
from clearcap.web.webhooks import REPORT_WITHIN

ON_A_PAGE = 50
router = APIRouter(include_in_schema=False)


@router.get("/campaigns")
async def campaigns_page(
    request: Request,
    service: TheService,
    _: Viewer,
    question: campaigns.ListQuery,
    cursor: Annotated[int, Query(ge=0, le=10**9)] = 0,
) -> Response:
    """Show the list of campaigns."""
    await service.watcher.list_first()
    known = list(service.watcher.index.entries())
    tags = [tag for tag in question.tag if tag]  # what a form sends empty stands for all
    question = question.model_copy(update={"owner": question.owner or None, "tag": tags})
    found = campaigns.listed(known, question)
    asked = question.model_dump(exclude_defaults=True)
    entries = [entry for entry, _ in found[cursor : cursor + ON_A_PAGE]]
    tags = sorted({tag for entry, _ in known for tag in entry.tags})
    owners = sorted({entry.owner for entry, _ in known if entry.owner})
    states = sorted({entry.state for entry, _ in known})
    following = cursor + ON_A_PAGE if cursor + ON_A_PAGE < len(found) else None
    values: dict[str, Any] = {"question": question, "entries": entries, "total": len(found), "on_a_page": ON_A_PAGE}
    values |= {"tags": tags, "owners": owners, "states": states, "cursor": cursor, "following": following}
    values["decides"] = {aimed: entry.campaign for entry, _ in known for aimed in entry.decided_by}
    values |= {"sorts": tuple(campaigns.ORDERS), "unread": service.watcher.index.unread, "fault": service.store_fault}
    return page(request, "campaigns", asked=asked, **values)


async def frame(request: Request, service: TheService, campaign: str, who: Authenticated) -> dict[str, Any]:
    """Return the values for the frame of a campaign's pages.

    `report_is_due`: it is still being written; `deciding`: campaign whose runs it waits for; `decides`: the one
    whose verdicts this campaign decides.
    """
    entry = await campaigns.show_campaign(service, campaign)
    known = [each for each, _ in service.watcher.index.entries()]
    deciding = next((e for e in known if e.campaign in entry.decided_by and e.state in ("queued", "running")), None)
    decides = next((e.campaign for e in known if campaign in e.decided_by), "")
    lacks_report = entry.state == "completed" and not entry.has_report and not entry.message
    is_recent = entry.since is not None and time.time() - entry.since.timestamp() < REPORT_WITHIN
    report_is_due = lacks_report and (is_recent or deciding is not None)
    is_own = who.may(Role.ENGINEER) and who.name == await run_in_threadpool(owner_of, service, campaign)
    values = {"entry": entry, "may_change": is_own or who.may(Role.ADMIN), "report_is_due": report_is_due}
    return {**values, "deciding": deciding, "decides": decides}


@router.get("/campaigns/{campaign}")
async def campaign_page(request: Request, service: TheService, campaign: TheCampaign, who: Authenticated) -> Response:
    """Show the progress of a campaign, which is updated while rows arrive."""
    seen = await run_in_threadpool(observe, service.store, campaign)
    shown = await frame(request, service, campaign, who)
    return page(request, "campaign", progress=progress_of(seen, is_served=service.watcher.is_served), **shown)


@router.get("/campaigns/{campaign}/histograms")
async def histograms_page(request: Request, service: TheService, campaign: TheCampaign, who: Authenticated) -> Response:
    """Show the histograms of the rows so far, with limits and each Cpk; the page of the campaign has them as a part."""
    try:
        found, fault = await or_fault(service.answers.ask(who.name, queries.histograms_answer, [campaign], [], False))
    except Busy as error:  # the page asks again by itself
        found, fault = None, str(error)
    shown = sorted(found["histograms"] if found else [], key=lambda each: each["lsl"] is None and each["usl"] is None)
    for each in shown:
        each |= {"n": sum(each["before"]), "figure": histogram_figure(each)}
        each["interval"] = preliminary_interval({"n": each["n"], "cpk": each["cpk"]})
    values: dict[str, Any] = {"histograms": shown, "fault": fault, "preliminary": PRELIMINARY}
    return page(request, "histograms", **values, **await frame(request, service, campaign, who))


@router.get("/work")
async def work_page(request: Request, service: TheService, _: Viewer) -> Response:
    """Show the campaigns that run and wait, with their workers."""
    await service.look_at_work()
    coordinate, followers = service.settings.coordinate, service.watcher.followers
    values: dict[str, Any] = {"work": service.workload, "fault": service.store_fault}
    return page(request, "work", coordinate=coordinate, followers=followers, **values)


@router.get("/campaigns/{campaign}/report")
async def report_page(request: Request, service: TheService, campaign: TheCampaign, who: Authenticated) -> Response:
    """Show the report of a campaign in a frame, and its files."""
    files = await run_in_threadpool(campaigns.report_files, service, campaign, who)
    return page(request, "report_frame", files=files, **await frame(request, service, campaign, who))


@router.post("/campaigns/{campaign}/report")
async def report_form(service: TheService, campaign: TheCampaign, who: Engineer) -> Response:
    """Write the report of a campaign again."""
    await campaigns.write_report(service, campaign, who)
    return RedirectResponse(f"/campaigns/{quote(campaign)}/report", 303)


@router.get("/campaigns/{campaign}/pool")
async def pool_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Viewer,
    shown: Annotated[str, Query(max_length=200)] = "",
) -> Response:
    """Show the campaigns that are one sample with this one, and their reports."""
    await service.watcher.list_first()
    name = campaign.rpartition("-")[0]  # plans that differ only in the seed have one name, with which their ids begin
    named = [pair for pair in service.watcher.index.entries() if pair[0].campaign.rpartition("-")[0] == name]
    alike = {entry.campaign: entry for entry, _ in campaigns.in_order(named, "newest")}
    sound = [each for each, entry in alike.items() if each != campaign and entry.state != "broken"]
    others = sound[: campaigns.MOST_POOLED]
    job = service.answers.made(who.name, possible_members, service.store.files.full_url, campaign, tuple(others))
    found = json.loads(await job)
    refused: dict[str, list[str]] = {}
    for each in found["others"]:
        if each["refusal"]:
            refused.setdefault(each["refusal"], []).append(each["campaign"])
    files = await run_in_threadpool(campaigns.report_files, service, campaign, who)
    values: dict[str, Any] = {"possible": [each for each in found["others"] if not each["refusal"]], "refused": refused}
    values |= {"entries": alike, "pools": files.pools, "shown": shown if shown in files.pools else ""}
    values |= {"reason": found["refusal"], "seed": 1 + max(each["seed"] for each in (found, *found["others"]))}
    return page(request, "pool", **values, **await frame(request, service, campaign, who))


@router.post("/campaigns/{campaign}/pool")
async def pool_form(
    service: TheService,
    campaign: TheCampaign,
    who: Engineer,
    others: Annotated[list[Annotated[str, Field(pattern=CAMPAIGN_ID)]], Form(max_length=campaigns.MOST_POOLED)] = [],  # noqa: B006
) -> Response:
    """Write the report of several campaigns as one."""
    made = await campaigns.write_pool(service, campaign, who, campaigns.PoolRequest(others=others))
    return RedirectResponse(f"/campaigns/{quote(campaign)}/pool?shown={quote(made.pool, safe='')}", 303)


@router.post("/campaigns/{campaign}/cancel")
async def cancel_form(service: TheService, campaign: OwnCampaign) -> Response:
    """End a campaign."""
    await run_in_threadpool(campaigns.cancel, service, campaign)
    return RedirectResponse(f"/campaigns/{quote(campaign)}", 303)


@router.post("/campaigns/{campaign}/resume")
async def resume_form(service: TheService, campaign: OwnCampaign, who: Engineer) -> Response:
    """Continue a campaign."""
    await campaigns.resume(service, campaign, who)
    return RedirectResponse(f"/campaigns/{quote(campaign)}", 303)


@router.post("/campaigns/{campaign}/rerun")
async def rerun_form(service: TheService, campaign: OwnCampaign, who: Engineer) -> Response:
    """Compute failed rows again."""
    await campaigns.rerun(service, campaign, who, campaigns.FailedRows())
    return RedirectResponse(f"/campaigns/{quote(campaign)}", 303)


@router.post("/campaigns/{campaign}/extend")
async def extend_form(
    service: TheService, campaign: TheCampaign, who: Engineer, samples: Annotated[int, Form(ge=1, le=100_000_000)]
) -> Response:
    """Submit a campaign with more samples."""
    made = await submissions.extend(service, campaign, who, samples)
    return RedirectResponse(f"/campaigns/{quote(made.campaign)}", 303)


class LabelForm(BaseModel):
    """The labels in the form of a campaign's page."""

    version: int = Field(ge=0)
    owner: str = Field("", max_length=200)
    tags: str = Field("", max_length=2000)
    note: str = Field("", max_length=5000)
    archived: bool = False
    is_own: bool = False  # the form had owner and archived, which only some may change


@router.post("/campaigns/{campaign}/labels")
async def labels_form(
    service: TheService, campaign: TheCampaign, who: Engineer, sent: Annotated[LabelForm, Form()]
) -> Response:
    """Change the owner, tags and note of a campaign, or archive it."""
    entry = await campaigns.show_campaign(service, campaign)
    wanted = set(sent.tags.replace(",", " ").split())
    add, remove = sorted(wanted - set(entry.tags)), sorted(set(entry.tags) - wanted)
    change = campaigns.LabelRequest(add_tags=add, remove_tags=remove, note=sent.note, version=sent.version)
    if sent.is_own:
        change = change.model_copy(update={"owner": sent.owner, "archived": sent.archived})
    await campaigns.label(service, campaign, who, change)
    return RedirectResponse(f"/campaigns/{quote(campaign)}", 303)


@router.post("/campaigns/{campaign}/delete")
async def delete_form(
    service: TheService, campaign: OwnCampaign, confirm: Annotated[str, Form(max_length=200)] = ""
) -> Response:
    """Delete a campaign with all its rows."""
    await run_in_threadpool(campaigns.delete, service, campaign, confirm)
    return RedirectResponse("/campaigns", 303)


@router.get("/campaigns/{campaign}/share")
async def share_page(request: Request, service: TheService, campaign: TheCampaign, who: Engineer) -> Response:
    """Show the shared links to a campaign."""
    return await _share_page(request, service, campaign, who)


@router.post("/campaigns/{campaign}/share")
async def share_form(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Engineer,
    days: Annotated[int, Form(ge=1, le=90)] = 14,
    note: Annotated[str, Form(max_length=200)] = "",
) -> Response:
    """Create a link, and show it this once."""
    new = people.NewShare(days=days, note=note)
    made = await run_in_threadpool(people.add_share, request, service, campaign, who, new)
    return await _share_page(request, service, campaign, who, made)


@router.post("/campaigns/{campaign}/share/{share}/revoke")
def revoke_share_form(service: TheService, campaign: TheCampaign, who: Engineer, share: people.ListedId) -> Response:
    """Revoke a link."""
    people.revoke_share(service, campaign, who, share)
    return RedirectResponse(f"/campaigns/{quote(campaign)}/share", 303)


async def _share_page(
    request: Request, service: Service, campaign: str, who: Principal, made: people.MadeShare | None = None
) -> Response:
    """Return the page with the links, and one that was just created."""
    links = await run_in_threadpool(service.tokens.shares, campaign)
    shares = [people.ListedShare.model_validate(link) for link in links]
    return page(request, "share", shares=shares, made=made, **await frame(request, service, campaign, who))


@router.get("/campaigns/{campaign}/signoff")
async def signoff_page(
    request: Request, service: TheService, campaign: TheCampaign, who: Authenticated, check: Flag = False
) -> Response:
    """Show who signed a campaign, and to an approver the content that they would sign."""
    shown = await frame(request, service, campaign, who)
    signed = await run_in_threadpool(signoffs.list_signoffs, service, campaign, who, check)
    content, why_not = None, "only a completed campaign is signed"
    if who.may(Role.APPROVER) and shown["entry"].state == "completed":
        try:
            content = await run_in_threadpool(signoffs.show_content, service, campaign, who)
        except StoreError:
            raise
        except CampaignError as error:  # it has no report yet
            why_not = str(error)
    values: dict[str, Any] = {"content": content, "why_not": why_not, "checked": check}
    values["longest_comment"] = LONGEST_COMMENT
    return page(request, "signoff", signoffs=signed, **values, **shown)


@router.post("/campaigns/{campaign}/signoff")
async def sign_form(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Approver,
    content: Annotated[str, Form(pattern="^[0-9a-f]{64}$")],
    comment: Annotated[str, Form(max_length=LONGEST_COMMENT)] = "",
) -> Response:
    """Sign a campaign."""
    await signoffs.sign_campaign(request, service, campaign, who, signoffs.Signing(content=content, comment=comment))
    return RedirectResponse(f"/campaigns/{quote(campaign)}/signoff", 303)


@router.post("/campaigns/{campaign}/signoff/withdraw")
def withdraw_form(
    service: TheService,
    campaign: TheCampaign,
    who: Approver,
    comment: Annotated[str, Form(min_length=1, max_length=LONGEST_COMMENT)],
) -> Response:
    """Withdraw the last sign-off of a campaign."""
    signoffs.withdraw_signoff(service, campaign, who, signoffs.Withdrawing(comment=comment))
    return RedirectResponse(f"/campaigns/{quote(campaign)}/signoff", 303)
