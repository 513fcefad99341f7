"""The page of what-if: distributions that change, the capability under them, advice, and the cheapest tolerances."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any
from urllib.parse import quote, urlencode

from fastapi import APIRouter, Form, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError
from campaign.plan import Plan, dump_spec
from clearcap.questions.whatif import share_in_words
from clearcap.web.access import Principal
from clearcap.web.http.authentication import Authenticated, Engineer, OwnCampaign, TheCampaign, TheService
from clearcap.web.http.responses import Refusal, refusal_of
from clearcap.web.jobs import queries
from clearcap.web.operations import samples
from clearcap.web.pages.campaigns import frame
from clearcap.web.pages.histograms import histogram_figure
from clearcap.web.pages.rendering import is_number, or_fault, page
from clearcap.web.web_service import Service

FIELD = "v."  # prefix of the name of a number's field, before VARIABLE.KEY
STEPS = 100  # steps of a slider
PLACES = ("mean", "nominal", "lower", "upper", "mode", "origin", "value", "log_mean")  # keys of location, not of scale
REACH, STRETCH = 2.0, 0.8  # reach of a slider to each side: sigmas for keys of location, share of the value for others
LONGEST_COSTS = 8000  # characters of the cost file in a URL
SUMMED_UP = 8  # responses in the summary that stays in sight on a telephone
router = APIRouter(include_in_schema=False)


@router.get("/campaigns/{campaign}/whatif")
async def what_if_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    set: samples.WhatIfSettings = [],  # noqa: B006  # FastAPI copies it
    others: Annotated[str, Query(max_length=queries.MOST_SETTINGS * queries.LONGEST_SETTING)] = "",
) -> Response:
    """Show the responses under other distributions; a sent form is redirected to the URL of its question."""
    plan = await run_in_threadpool(service.store.plan, campaign)
    given = {key: text for key, text in request.query_params.items() if key.startswith(FIELD)}
    settings = list(set)
    if given or others:
        settings = settings_of(variable_fields(plan, ()), given, others)
    texts = {key: request.query_params.get(key, "") for key in ("advice", "costs")}  # other questions; of a cost file
    asked = {key: text[:LONGEST_COSTS] for key, text in texts.items() if text.strip()}
    address = _address(campaign, settings, asked)
    is_part = request.headers.get("hx-request") == "true"
    if (given or others) and not is_part:
        return RedirectResponse(address, 303)
    answer = await _shown(request, service, campaign, who, plan, settings, asked)
    if is_part:
        answer.headers["HX-Replace-Url"] = address
    return answer


@router.post("/campaigns/{campaign}/whatif/confirm")
async def confirm_form(
    request: Request,
    service: TheService,
    campaign: OwnCampaign,
    who: Engineer,
    costs: Annotated[str, Form(max_length=LONGEST_COSTS)],
) -> Response:
    """Judge the cheapest tolerances by fresh runs, and show what these say so far."""
    plan, asked = await run_in_threadpool(service.store.plan, campaign), {"costs": costs}
    found, fault = None, ""
    try:
        found = await samples.confirm_allocation(service, campaign, who, samples.CostRequest(costs=costs))
    except (CampaignError, Refusal) as error:
        refusal = refusal_of(error)
        assert refusal is not None
        fault = str(refusal)
    return await _shown(request, service, campaign, who, plan, [], asked, confirmed=found, confirm_fault=fault)


def _address(campaign: str, settings: Sequence[str], asked: Mapping[str, str]) -> str:
    question = urlencode({"set": settings, **asked}, doseq=True)
    return f"/campaigns/{quote(campaign)}/whatif{'?' if question else ''}{question}"


async def _shown(
    request: Request,
    service: Service,
    campaign: str,
    who: Principal,
    plan: Plan,
    settings: Sequence[str],
    asked: dict[str, str],
    **of_fresh_runs: Any,
) -> Response:
    """Return the page of a question; `of_fresh_runs` is what they say of the cheapest tolerances, or why nothing."""
    fields = variable_fields(plan, settings)
    preview = request.query_params.get("preview") == "true"
    shown = await _answers(service, who.name, campaign, settings, preview)
    shown |= await _advice(service, who.name, campaign, asked)
    shown |= {"settings": settings, "fields": fields, "others": other_settings(fields, settings), "asked": asked}
    shown |= {"address": _address(campaign, settings, asked), "query": urlencode({"set": settings}, doseq=True)}
    shown["preview"] = preview
    shown["applied"] = lambda advised: f"?{urlencode({'set': replaced(settings, advised), **asked}, doseq=True)}"
    shown |= {"confirmed": None, "confirm_fault": "", **of_fresh_runs}
    return page(request, "whatif", **shown, **await frame(request, service, campaign, who))


async def _answers(
    service: Service, user: str, campaign: str, settings: Sequence[str], preview: bool
) -> dict[str, Any]:
    """Return the histograms and, with settings, the what-if document, or why there is none."""
    ask = service.answers.ask
    bins, fault = await or_fault(ask(user, queries.histograms_answer, [campaign], settings, preview))
    if fault and settings:  # a setting is wrong, so show the samples without settings
        bins, _ = await or_fault(ask(user, queries.histograms_answer, [campaign], [], preview))
    document = None
    if settings and not fault:
        document, fault = await or_fault(ask(user, queries.what_if_answer, [campaign], settings, preview))
    histograms = sorted(
        bins["histograms"] if bins else [], key=lambda each: each["lsl"] is None and each["usl"] is None
    )
    figures = {each["response"]: histogram_figure(each) for each in histograms}
    responses = document["responses"] if document else {}
    summary = sorted(
        (each for each in histograms if each["cpk"] is not None),
        key=lambda each: ((responses.get(each["response"]) or {}).get("cpk") or {"value": each["cpk"]})["value"],
    )
    return {
        **{"histograms": histograms, "figures": figures, "document": document, "fault": fault},
        **{"summary": summary[:SUMMED_UP], "share_in_words": share_in_words},
    }


async def _advice(service: Service, user: str, campaign: str, asked: dict[str, str]) -> dict[str, Any]:
    """Return the advice and the allocation that the URL asks for, or why there are none."""
    shown: dict[str, Any] = {"advice": None, "advice_fault": "", "allocation": None, "allocation_fault": ""}
    ask = service.answers.ask
    if "advice" in asked:
        shown["advice"], shown["advice_fault"] = await or_fault(ask(user, queries.advice_answer, [campaign]))
    if "costs" in asked:
        found, shown["allocation_fault"] = await or_fault(
            ask(user, queries.allocation_answer, [campaign], asked["costs"])
        )
        shown["allocation"] = found and found["allocation"]
    return shown


@dataclass(frozen=True)
class KeyField:
    """A key of a distribution that can be set."""

    setting: str  # ``VARIABLE.KEY``, without ``=VALUE``
    key: str
    now: float  # value in the campaign
    text: str  # value in the question
    low: float  # end of the slider, as is `high`
    high: float
    step: float


@dataclass(frozen=True)
class VariableFields:
    """The keys of a variable's distribution that can be set."""

    name: str
    unit: str
    distribution: str
    keys: list[KeyField]


def variable_fields(plan: Plan, settings: Sequence[str]) -> list[VariableFields]:
    """Return the fields of the variables with a nonzero sigma, filled with the settings of a question."""
    asked = dict(setting.partition("=")[::2] for setting in settings)
    found = []
    for name, table in dump_spec(plan.spec)["variables"].items():
        sigma = plan.spec.variables[name].moments()[1]
        numbers = {key: float(x) for key, x in table.items() if isinstance(x, int | float) and not isinstance(x, bool)}
        if sigma > 0:
            unit = (plan.schema.field(name).metadata or {}).get(b"unit", b"").decode()
            keys = [_field(name, key, now, sigma, asked) for key, now in numbers.items()]
            found.append(VariableFields(name, "" if unit == "1" else unit, table["distribution"], keys))
    return found


def other_settings(fields: Iterable[VariableFields], settings: Sequence[str]) -> list[str]:
    """Return the settings that no field shows."""
    shown = {key.setting for each in fields for key in each.keys}
    return [setting for setting in settings if setting.partition("=")[0] not in shown]


def replaced(settings: Sequence[str], advised: Sequence[str]) -> list[str]:
    """Return settings with those of an advice instead of those of the same keys."""
    keys = {setting.partition("=")[0] for setting in advised}
    return [setting for setting in settings if setting.partition("=")[0] not in keys] + list(advised)


def settings_of(fields: Iterable[VariableFields], given: Mapping[str, str], others: str) -> list[str]:
    """Return the settings of a sent form: those of numbers that differ from the campaign's, then the others."""
    changed = []
    for key in (key for each in fields for key in each.keys):
        text = given.get(f"{FIELD}{key.setting}", "").strip()
        if text and not is_number(text, key.now):
            changed.append(f"{key.setting}={text}")
    return changed + [line.strip() for line in others.splitlines() if line.strip()]


def _field(name: str, key: str, now: float, sigma: float, asked: Mapping[str, str]) -> KeyField:
    """Return the field of a key, with the present value in the middle of its slider."""
    half = REACH * sigma if key in PLACES or now == 0 else STRETCH * abs(now)
    text = asked.get(f"{name}.{key}", repr(now))
    return KeyField(f"{name}.{key}", key, now, text, now - half, now + half, 2 * half / STEPS)
