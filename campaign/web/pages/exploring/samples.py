"""The pages of samples: a table with the worst or failed ones, and a page for each with row, replay and pictures."""

import json
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from campaign.errors import CampaignError
from campaign.web.access import Principal
from campaign.web.answers.sample_page import SORTS, STATUSES
from campaign.web.api.samples import ReplayedSample, Sample, SampleQuestion, motion_of, replay, show_sample
from campaign.web.api.whose import TheCampaign
from campaign.web.http.asking import Asking, TheService, Viewer
from campaign.web.http.problems import refusal_of
from campaign.web.pages.campaigns import frame
from campaign.web.pages.rendering import page
from campaign.web.web_service import Service
from engine import EngineError

router = APIRouter(include_in_schema=False)


@router.get("/campaigns/{campaign}/samples")
async def samples_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Asking,
    question: Annotated[SampleQuestion, Query()],
) -> Response:
    """Show samples in a table, by default the worst first."""
    asked = (question.sort, question.status or None, question.cursor, question.limit)
    found = json.loads((await service.answers.samples(who.name, campaign, *asked)).content)
    kept = {
        key: value for key, value in question.model_dump(exclude_defaults=True).items() if key != "cursor" and value
    }
    values: dict[str, Any] = {"question": question, "found": found, "kept": kept, "sorts": SORTS, "statuses": STATUSES}
    return page(request, "samples", **values, **await frame(request, service, campaign, who))


@router.get("/campaigns/{campaign}/samples/{sample}")
async def sample_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Asking,
    sample: Sample,
    pictures: Annotated[bool, Query()] = False,
) -> Response:
    """Show a sample."""
    return await _sample_page(request, service, campaign, who, sample, pictures=pictures)


@router.post("/campaigns/{campaign}/samples/{sample}/replay")
async def replay_form(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample
) -> Response:
    """Compute a sample again, and show whether the result is equal bit for bit."""
    replayed = await replay(service, campaign, who, sample)
    return await _sample_page(request, service, campaign, who, sample, replayed=replayed)


async def _sample_page(
    request: Request,
    service: Service,
    campaign: str,
    who: Principal,
    sample: int,
    *,
    replayed: ReplayedSample | None = None,
    pictures: bool = False,
) -> Response:
    """Return the page of a sample, with its replay if there is one."""
    shown = await run_in_threadpool(show_sample, service, campaign, sample)
    values: dict[str, Any] = {"s": shown, "replayed": replayed, "pictures": pictures, "moving": None}
    refusal = None
    if pictures and who.kind != "share":
        try:
            values["moving"] = json.loads(await motion_of(service, campaign, who, sample))
        except (CampaignError, EngineError) as error:  # the row is shown even without the motion
            refusal = refusal_of(error)
    return page(request, "sample", refusal=refusal, **values, **await frame(request, service, campaign, who))
