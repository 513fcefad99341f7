"""The what-if page: results of the samples under changed distributions, advice, and cheapest tolerances."""

import json
from collections.abc import Awaitable, Sequence
from typing import Annotated, Any
from urllib.parse import quote, urlencode

from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError, StoreError
from campaign.web.answers.answers import LONGEST_SETTING, MOST_SETTINGS, Answer
from campaign.web.answers.turns import Busy
from campaign.web.api.questions import Settings
from campaign.web.api.whose import TheCampaign
from campaign.web.http.asking import Asking, TheService
from campaign.web.pages.campaigns import frame
from campaign.web.pages.exploring.histogram_figure import HEIGHT, WIDTH, histogram_figure
from campaign.web.pages.exploring.whatif_form import FIELD, other_settings, settings_of, variable_fields
from campaign.web.pages.rendering import page
from campaign.web.web_service import Service

router = APIRouter(include_in_schema=False)
LONGEST_COSTS = 8000  # characters of the cost file in a URL


@router.get("/campaigns/{campaign}/whatif")
async def what_if_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Asking,
    set: Settings = [],  # noqa: B006  # FastAPI copies it
    others: Annotated[str, Query(max_length=MOST_SETTINGS * LONGEST_SETTING)] = "",
) -> Response:
    """Show the responses under other distributions; a sent form is redirected to the URL of its question."""
    plan = await run_in_threadpool(service.store.plan, campaign)
    given = {key: text for key, text in request.query_params.items() if key.startswith(FIELD)}
    settings = list(set)
    if given or others:
        settings = settings_of(variable_fields(plan, ()), given, others)
    asked = _other_questions(request)
    address = _address(campaign, settings, asked)
    is_part = request.headers.get("hx-request") == "true"
    if (given or others) and not is_part:
        return RedirectResponse(address, 303)
    fields = variable_fields(plan, settings)
    preview = request.query_params.get("preview") == "true"
    shown = await _answers(service, who.name, campaign, settings, preview)
    shown |= await _advice(service, who.name, campaign, asked)
    answer = page(
        request,
        "whatif",
        settings=settings,
        fields=fields,
        others=other_settings(fields, settings),
        asked=asked,
        address=address,
        query=urlencode({"set": settings}, doseq=True),
        width=WIDTH,
        height=HEIGHT,
        **shown,
        **await frame(request, service, campaign, who),
    )
    if is_part:
        answer.headers["HX-Replace-Url"] = address
    return answer


def _other_questions(request: Request) -> dict[str, str]:
    """Return the other questions of a URL: ``advice``, and ``costs``, the text of a cost file."""
    asked = {"advice": request.query_params.get("advice", ""), "costs": request.query_params.get("costs", "")}
    return {key: text[:LONGEST_COSTS] for key, text in asked.items() if text.strip()}


def _address(campaign: str, settings: Sequence[str], asked: dict[str, str]) -> str:
    """Return the URL path of a question."""
    query = urlencode({"set": list(settings), **asked}, doseq=True)
    return f"/campaigns/{quote(campaign)}/whatif{'?' if query else ''}{query}"


async def _answers(
    service: Service, user: str, campaign: str, settings: Sequence[str], preview: bool
) -> dict[str, Any]:
    """Return the histograms and, with settings, the what-if document, or why there is none."""
    answers = service.answers
    bins, fault = await _or_fault(answers.histograms(user, campaign, settings, preview=preview))
    if fault and settings:  # a setting is wrong, so show the samples without settings
        bins, _ = await _or_fault(answers.histograms(user, campaign, preview=preview))
    document = None
    if settings and not fault:
        document, fault = await _or_fault(answers.what_if(user, campaign, settings, preview=preview))
    histograms = sorted(bins["histograms"] if bins else [], key=_has_no_limit)
    figures = {each["response"]: histogram_figure(each) for each in histograms}
    return {"histograms": histograms, "figures": figures, "document": document, "fault": fault}


def _has_no_limit(bins: dict[str, Any]) -> bool:
    """Return whether a response has no limit, as a sort key that puts it after those with one."""
    return bins["lsl"] is None and bins["usl"] is None


async def _advice(service: Service, user: str, campaign: str, asked: dict[str, str]) -> dict[str, Any]:
    """Return the advice and the allocation that the URL asks for, or why there are none."""
    shown: dict[str, Any] = {"advice": None, "advice_fault": "", "allocation": None, "allocation_fault": ""}
    if "advice" in asked:
        shown["advice"], shown["advice_fault"] = await _or_fault(service.answers.advise(user, campaign))
    if "costs" in asked:
        found, shown["allocation_fault"] = await _or_fault(service.answers.allocate(user, campaign, asked["costs"]))
        shown["allocation"] = found and found["allocation"]
    return shown


async def _or_fault(answer: Awaitable[Answer]) -> tuple[Any, str]:
    """Return the document of an answer and an empty text, or None and the fault of the question."""
    try:
        return json.loads((await answer).content), ""
    except (Busy, StoreError):
        raise
    except CampaignError as error:
        return None, str(error)
