"""The what-if page: results of the samples under changed distributions, advice, and cheapest tolerances."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any
from urllib.parse import quote, urlencode

from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.plan import Plan, dump_spec
from clearcap.web.answers.query_service import LONGEST_SETTING, MOST_SETTINGS
from clearcap.web.http.authentication import Authenticated, TheCampaign, TheService
from clearcap.web.operations.samples import WhatIfSettings
from clearcap.web.pages.campaigns import frame
from clearcap.web.pages.rendering import is_number, or_fault, page
from clearcap.web.web_service import Service

WIDTH, HEIGHT = 320.0, 110.0  # size of the drawing, in its own units
FIELD = "v."  # prefix of the name of a number's field, before VARIABLE.KEY
STEPS = 100  # steps of a slider
PLACES = ("mean", "nominal", "lower", "upper", "mode", "origin", "value", "log_mean")  # keys of location, not of scale
REACH, STRETCH = 2.0, 0.8  # reach of a slider to each side: sigmas for keys of location, share of the value for others
router = APIRouter(include_in_schema=False)
LONGEST_COSTS = 8000  # characters of the cost file in a URL


@router.get("/campaigns/{campaign}/whatif")
async def what_if_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    set: WhatIfSettings = [],  # noqa: B006  # FastAPI copies it
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
    bins, fault = await or_fault(answers.histograms(user, campaign, settings, preview=preview))
    if fault and settings:  # a setting is wrong, so show the samples without settings
        bins, _ = await or_fault(answers.histograms(user, campaign, preview=preview))
    document = None
    if settings and not fault:
        document, fault = await or_fault(answers.what_if(user, campaign, settings, preview=preview))
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
        shown["advice"], shown["advice_fault"] = await or_fault(service.answers.advise(user, campaign))
    if "costs" in asked:
        found, shown["allocation_fault"] = await or_fault(service.answers.allocate(user, campaign, asked["costs"]))
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


@dataclass(frozen=True)
class Figure:
    """The drawing of a histogram."""

    # (x, y, width, height); heights are counts divided by bin widths, so that areas are proportional to counts.
    bars: list[tuple[float, float, float, float]]
    after: str  # points of the outline under the new distributions; empty without them
    limits: list[tuple[float, str]]  # places and names of the limits within the drawing
    lower: float  # left end of the axis, in the unit of the response
    upper: float  # right end


def histogram_figure(bins: Mapping[str, Any]) -> Figure | None:
    """Return the figure of the bins of a response; None if it has no values."""
    edges = bins["edges"]
    if len(edges) < 2 or not edges[-1] > edges[0]:
        return None
    before = _heights(edges, bins["before"])
    after = _heights(edges, bins["after"]) if bins["after"] else []
    scale = HEIGHT / (max([*before, *after]) or 1.0)

    def x_of(value: float) -> float:
        return round(float(WIDTH * (value - edges[0]) / (edges[-1] - edges[0])), 2)

    bars = [
        (
            x_of(edges[i]),
            round(HEIGHT - h * scale, 2),
            round(x_of(edges[i + 1]) - x_of(edges[i]), 2),
            round(h * scale, 2),
        )
        for i, h in enumerate(before)
    ]
    corners = [(0.0, HEIGHT)]
    for i, h in enumerate(after):
        y = round(HEIGHT - h * scale, 2)
        corners += [(x_of(edges[i]), y), (x_of(edges[i + 1]), y)]
    outline = " ".join(f"{x:g},{y:g}" for x, y in [*corners, (WIDTH, HEIGHT)]) if after else ""
    limits = [
        (x_of(bins[key]), words)
        for key, words in (("lsl", "lower limit"), ("usl", "upper limit"))
        if bins[key] is not None and edges[0] <= bins[key] <= edges[-1]
    ]
    return Figure(bars, outline, limits, edges[0], edges[-1])


def _heights(edges: Sequence[float], counts: Sequence[float]) -> list[float]:
    """Return counts divided by the widths of their bins."""
    return [c / (b - a) if b > a else 0.0 for c, a, b in zip(counts, edges, edges[1:], strict=False)]
