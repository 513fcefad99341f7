"""Calls that check the text of a campaign, submit it, or extend it by more samples."""

from collections import Counter
from typing import Annotated, Any

from fastapi import Header
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from campaign.coordinator.state import STATES
from campaign.store.labels import LabelChange
from campaign.web.access import Principal
from campaign.web.access.request_keys import RequestKeys
from campaign.web.api.calls import PREFIX, calls
from campaign.web.api.posted_campaign import POSTED, CampaignRequest, PostedCampaign
from campaign.web.api.whose import TheCampaign
from campaign.web.http.asking import Engineer, TheService
from campaign.web.http.problems import Refusal, described
from campaign.web.jobs.campaigns import CampaignSource, check_campaign_text, extend_campaign, submit_text
from campaign.web.web_service import Service
from reporting import format_numbers

router = calls("campaigns")
REPEATED_TIMES = 2.0  # duration of a repeat, which has half the step, relative to that of its run
UNFINISHED = ("queued", "running", "interrupted")
assert set(UNFINISHED) <= set(STATES)


class RunCost(BaseModel):
    """The cost of a campaign."""

    runs: int = Field(description="Samples, and those of them that are repeated with half the step", examples=[515])
    seconds_per_run: float | None = Field(description="Of one worker; null if it is not known", examples=[0.03])
    workers: int | None = Field(description="Those of this server; null if others compute", examples=[2])
    seconds: float | None = Field(description="All runs on these workers, or on one", examples=[8.0])
    text: str = Field(description="The same in words", examples=["515 runs, about 8 s on 2 workers"])


class CheckedCampaign(BaseModel):
    """A campaign without faults."""

    campaign: str = Field(description="The id that it would have", examples=["demo-0a1b2c3d4e"])
    exists: bool = Field(description="The store has it already")
    name: str
    title: str
    mechanism: str
    samples: int
    variables: list[str]
    responses: list[str]
    cautions: list[str] = Field(description="What looks wrong, but can be computed")
    cost: RunCost


class SubmittedCampaign(BaseModel):
    """A campaign that is in the store."""

    campaign: str = Field(description="Its id", examples=["demo-0a1b2c3d4e"])
    is_new: bool = Field(description="It was not in the store before")
    owner: str = Field(description="Whose it is", examples=["eva"])
    samples: int
    cost: RunCost
    note: str = ""


_MADE: dict[int | str, dict[str, Any]] = {
    200: {"model": SubmittedCampaign, "description": "The store already had it"},
    201: {"headers": {"Location": {"schema": {"type": "string"}, "description": "The campaign"}}},
}


@router.post("/checks/campaign", openapi_extra=POSTED, responses=described(409, 415))
async def check_campaign(service: TheService, who: Engineer, wanted: PostedCampaign) -> CheckedCampaign:
    """Check the text of a campaign; return its cautions and cost, or its faults with key and line as a problem."""
    return await checked(service, who, wanted)


async def checked(
    service: Service, who: Principal, wanted: CampaignRequest, *, tries_runs: bool = False
) -> CheckedCampaign:
    """Check a campaign; with `tries_runs`, simulate some runs to estimate its cost."""
    found = await service.pool.data(who.name, check_campaign_text, source_of_request(service, wanted), tries_runs)
    return CheckedCampaign(**found, cost=cost_of(service, found))


@router.post(
    "/campaigns",
    status_code=201,
    response_model=SubmittedCampaign,
    openapi_extra=POSTED,
    responses={**_MADE, **described(409, 415)},
)
async def submit_campaign(
    service: TheService,
    who: Engineer,
    wanted: PostedCampaign,
    key: Annotated[
        str | None,
        Header(
            alias="Idempotency-Key",
            min_length=1,
            max_length=200,
            description="The same key and content give the same answer for a day, however often they are sent",
        ),
    ] = None,
) -> Response:
    """Submit a campaign; it is planned and queued, and the coordinator that serves the store computes it."""
    if key is None:
        return _answer(await submitted(service, who, wanted))
    keys = RequestKeys(service.database)
    digest = await run_in_threadpool(wanted.digest)
    known = await run_in_threadpool(keys.claim, who.name, key, digest)
    if known is not None:
        return _answer(SubmittedCampaign.model_validate_json(known[1]), known[0])
    try:
        made = await submitted(service, who, wanted)
    except BaseException:
        keys.release(who.name, key)
        raise
    status, text = await run_in_threadpool(keys.keep, who.name, key, _status(made), made.model_dump_json())
    return _answer(SubmittedCampaign.model_validate_json(text), status)


async def submitted(service: Service, who: Principal, wanted: CampaignRequest) -> SubmittedCampaign:
    """Submit a campaign; refuse (429) if the user has as many unfinished campaigns as is allowed.

    Raises CampaignError if the campaign has faults, or if the store cannot be written.
    """
    labels = LabelChange(who.name if wanted.owner is None else wanted.owner, tuple(wanted.tags))
    return await _made(service, who, submit_text, source_of_request(service, wanted), labels, who.name)


class MoreSamples(BaseModel):
    """The number of samples that a campaign is to have."""

    samples: int = Field(ge=1, le=100_000_000, description="In all", examples=[60])


@router.post(
    "/campaigns/{campaign}/extend",
    status_code=201,
    response_model=SubmittedCampaign,
    responses={**_MADE, **described(404, 409)},
)
async def extend(service: TheService, campaign: TheCampaign, who: Engineer, wanted: MoreSamples) -> Response:
    """Submit a campaign with more samples of the same spec; the rows that the store has are reused."""
    return _answer(await extended(service, campaign, who, wanted.samples))


async def extended(service: Service, campaign: str, who: Principal, samples: int) -> SubmittedCampaign:
    """Submit a campaign with more samples; raise the errors of `submitted`."""
    address, most = service.store.files.full_url, service.settings.limits.samples
    return await _made(service, who, extend_campaign, address, campaign, samples, most, who.name)


async def _made(service: Service, who: Principal, job: Any, *arguments: Any) -> SubmittedCampaign:
    """Let a job plan a campaign, unless the user has too many unfinished ones."""
    # counted before the check, so that simultaneous submissions cannot exceed the limit together
    service.submitting[who.name] += 1
    try:
        await _check_unfinished(service, who)
        made = await service.pool.data(who.name, job, *arguments)
    finally:
        service.submitting[who.name] -= 1
    await service.watcher.list_campaigns(made["campaign"])
    note = "" if made["is_new"] else f"the store already had it; its owner is {made['owner'] or 'nobody'}"
    if made["is_new"] and made["reuse"] and job is extend_campaign:
        note = f"all rows are computed again: {made['reuse']}"
    return SubmittedCampaign(**{**made, "cost": cost_of(service, made), "note": note})


async def _check_unfinished(service: Service, who: Principal) -> None:
    """Raise Refusal (429) if the user has too many unfinished campaigns, including those being submitted now."""
    most = service.settings.limits.running
    await service.watcher.list_all()
    entries = [entry for entry, _ in service.watcher.index.entries() if entry.submitted_by == who.name]
    unfinished = Counter(entry.state for entry in entries if entry.state in UNFINISHED)
    if unfinished.total() + service.submitting[who.name] > most:
        counts = ", ".join(f"{count} {state}" for state, count in unfinished.items()) or "others on their way"
        raise Refusal(
            429,
            f"{who.name} may have {most} unfinished campaigns, and has {counts}; wait for one, or cancel one",
            headers={"Retry-After": "60"},
        )


def source_of_request(service: Service, wanted: CampaignRequest) -> CampaignSource:
    """Return the source of a posted campaign for a job."""
    address, most = service.store.files.full_url, service.settings.limits.samples
    return CampaignSource(address, wanted.text, wanted.files, wanted.samples, wanted.seed, most)


def cost_of(service: Service, size: dict[str, Any]) -> RunCost:
    """Return the cost of a campaign from the size that a job returned."""
    samples, share, each = size["samples"], size["repeats"], size["seconds_per_run"]
    runs, workers = samples + round(samples * share), service.settings.workers
    words = f"{format_numbers.grouped(runs)} runs"
    if each is None:
        seconds, words = None, f"{words}; how long one takes is not known yet"
    else:
        seconds = each * samples * (1.0 + REPEATED_TIMES * share) / (workers or 1)
        where = f"on {workers or 1} worker{'' if workers in (1, None) else 's'}"
        words = f"{words}, about {format_numbers.duration(seconds)} {where}"
    return RunCost(runs=runs, seconds_per_run=each, workers=workers, seconds=seconds, text=words)


def _status(made: SubmittedCampaign) -> int:
    return 201 if made.is_new else 200


def _answer(made: SubmittedCampaign, status: int | None = None) -> Response:
    """Return the answer to a submission."""
    headers = {"Location": f"{PREFIX}/campaigns/{made.campaign}"}
    return Response(made.model_dump_json(), status or _status(made), headers, "application/json")
