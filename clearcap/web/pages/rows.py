"""Pages for the rows of a campaign: samples, comparison with another campaign, exports, and what-if."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any
from urllib.parse import quote, urlencode

from fastapi import APIRouter, Form, Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError, FailedStatus
from campaign.plan import Plan, dump_spec
from clearcap.questions.exported_rows import FORMATS
from clearcap.questions.samples import OK, SORTS, STATUSES, ReplayedSample, sample_motion
from clearcap.web.access import Principal
from clearcap.web.http.authentication import (
    CAMPAIGN_ID,
    Authenticated,
    Engineer,
    TheCampaign,
    TheService,
    Viewer,
    the_campaign,
)
from clearcap.web.http.responses import refusal_of
from clearcap.web.jobs import queries
from clearcap.web.operations import campaigns, samples
from clearcap.web.pages.campaigns import frame
from clearcap.web.pages.rendering import Flag, is_number, or_fault, page
from clearcap.web.settings import PREFIX
from clearcap.web.web_service import Service
from engine import EngineError

READERS = {  # Python imports and expression that read each format from an open answer
    "arrow": ("import pyarrow as pa", "pa.ipc.open_stream(answer).read_all()"),
    "parquet": ("import io\n\nimport pyarrow.parquet as pq", "pq.read_table(io.BytesIO(answer.read()))"),
    "csv": ("import pyarrow.csv", "pyarrow.csv.read_csv(answer)"),
}
MOST_OFFERED = 500  # campaigns to choose from
router = APIRouter(include_in_schema=False)


@router.get("/campaigns/{campaign}/samples")
async def samples_page(
    request: Request, service: TheService, campaign: TheCampaign, who: Authenticated, question: samples.SampleQuery
) -> Response:
    """Show samples in a table, by default the worst first."""
    asked = (question.sort, question.status or None, question.cursor, question.limit)
    found = json.loads(await service.answers.ask(who.name, queries.samples_answer, [campaign], *asked))
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
    who: Authenticated,
    sample: samples.Sample,
    pictures: Flag = False,
) -> Response:
    """Show a sample."""
    return await _sample_page(request, service, campaign, who, sample, pictures=pictures)


@router.post("/campaigns/{campaign}/samples/{sample}/replay")
async def replay_form(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: samples.Sample
) -> Response:
    """Compute a sample again, and show whether the result is equal bit for bit."""
    replayed = await samples.replay(service, campaign, who, sample)
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
    shown = await run_in_threadpool(samples.show_sample, service, campaign, sample)
    values: dict[str, Any] = {"s": shown, "replayed": replayed, "pictures": pictures, "moving": None}
    refusal = None
    if pictures and who.kind != "share":
        try:
            values["moving"] = json.loads(await samples.drawn(service, campaign, who, sample, sample_motion))
        except (CampaignError, EngineError) as error:  # the row is shown even without the motion
            refusal = refusal_of(error)
    return page(request, "sample", refusal=refusal, **values, **await frame(request, service, campaign, who))


@router.get("/campaigns/{campaign}/compare")
async def compare_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Viewer,
    other: Annotated[str, Query(alias="with", pattern=CAMPAIGN_ID + "|^$")] = "",
) -> Response:
    """Show the comparison of a campaign with another one."""
    found, fault = None, ""
    if other:
        await the_campaign(service, who, other)
        found, fault = await or_fault(service.answers.ask(who.name, queries.comparison_answer, [campaign, other]))
    await service.watcher.list_first()
    entries = [entry for entry, _ in service.watcher.index.entries() if entry.campaign != campaign]
    files = await run_in_threadpool(campaigns.report_files, service, campaign, who)
    values: dict[str, Any] = {"other": other, "comparison": found and found["comparison"], "fault": fault}
    values |= {"differs": found["differs"] if found else []}
    values |= {"offered": entries[:MOST_OFFERED], "written": files.comparisons.get(other, [])}
    return page(request, "compare", **values, **await frame(request, service, campaign, who))


@router.post("/campaigns/{campaign}/compare")
async def compare_form(
    service: TheService,
    campaign: TheCampaign,
    who: Engineer,
    other: Annotated[str, Form(alias="with", pattern=CAMPAIGN_ID)],
) -> Response:
    """Write the report of a comparison."""
    await campaigns.write_comparison(service, campaign, who, other)
    return RedirectResponse(f"/campaigns/{campaign}/compare?{urlencode({'with': other})}", 303)


class ExportForm(BaseModel):
    """The sent form of this page: the parameters of the call, but numbers may be empty, and columns are one text."""

    format: str = Field("parquet", pattern="^(arrow|parquet|csv)$")
    columns: str = Field("", max_length=20_000)
    first: str = Field("", pattern=r"^\d{0,15}$")
    last: str = Field("", pattern=r"^\d{0,15}$")
    status: str = Field("", max_length=40)

    def query(self) -> str:
        """Return the query of the equivalent API call."""
        asked = {"format": self.format, "columns": self.columns.replace(",", " ").split()}
        given = {"first": self.first, "last": self.last, "status": self.status}
        return urlencode(asked | {key: text for key, text in given.items() if text}, doseq=True)


@router.get("/campaigns/{campaign}/export")
async def export_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    form: Annotated[ExportForm, Query()],
) -> Response:
    """Show the files and rows that can be exported, with the command and the Python lines that do the same."""
    files = await run_in_threadpool(campaigns.report_files, service, campaign, who)
    call = f"{PREFIX}/campaigns/{campaign}/rows?{form.query()}"
    name = f"{campaign}.{samples.ENDINGS[form.format]}"
    imports, reader = READERS[form.format]
    curl = f'curl -H "Authorization: Bearer $CLEARCAP_TOKEN" "{service.settings.address}{call}" -o {name}'
    python = [
        "import os",
        "import urllib.request",
        *imports.splitlines(),
        "",
        f'request = urllib.request.Request("{service.settings.address}{call}")',
        'request.add_header("Authorization", "Bearer " + os.environ["CLEARCAP_TOKEN"])',
        "with urllib.request.urlopen(request) as answer:",
        f"    rows = {reader}",
    ]
    values: dict[str, Any] = {"form": form, "files": files, "call": call, "name": name, "curl": curl}
    values |= {"python": "\n".join(python), "formats": list(FORMATS), "statuses": (OK, *FailedStatus)}
    return page(request, "export", **values, **await frame(request, service, campaign, who))


WIDTH, HEIGHT = 320.0, 110.0  # size of the drawing, in its own units
FIELD = "v."  # prefix of the name of a number's field, before VARIABLE.KEY
STEPS = 100  # steps of a slider
PLACES = ("mean", "nominal", "lower", "upper", "mode", "origin", "value", "log_mean")  # keys of location, not of scale
REACH, STRETCH = 2.0, 0.8  # reach of a slider to each side: sigmas for keys of location, share of the value for others
LONGEST_COSTS = 8000  # characters of the cost file in a URL


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
    question = urlencode({"set": settings, **asked}, doseq=True)
    address = f"/campaigns/{quote(campaign)}/whatif{'?' if question else ''}{question}"
    is_part = request.headers.get("hx-request") == "true"
    if (given or others) and not is_part:
        return RedirectResponse(address, 303)
    fields = variable_fields(plan, settings)
    preview = request.query_params.get("preview") == "true"
    shown = await _answers(service, who.name, campaign, settings, preview)
    shown |= await _advice(service, who.name, campaign, asked)
    shown |= {"settings": settings, "fields": fields, "others": other_settings(fields, settings), "asked": asked}
    shown |= {"address": address, "query": urlencode({"set": settings}, doseq=True), "width": WIDTH, "height": HEIGHT}
    answer = page(request, "whatif", **shown, **await frame(request, service, campaign, who))
    if is_part:
        answer.headers["HX-Replace-Url"] = address
    return answer


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
    return {"histograms": histograms, "figures": figures, "document": document, "fault": fault}


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
