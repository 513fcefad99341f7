"""Pages for the rows of a campaign: samples, comparison with another campaign, and exports."""

import json
from collections.abc import Mapping
from typing import Annotated, Any
from urllib.parse import quote, urlencode

from fastapi import APIRouter, Form, Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError, FailedStatus
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
from clearcap.web.pages.clouds import dots_figure, parallel_figure
from clearcap.web.pages.rendering import Flag, or_fault, page
from clearcap.web.settings import PREFIX
from clearcap.web.web_service import Service
from engine import EngineError

READERS = {  # Python imports and expression that read each format from an open answer
    "arrow": ("import pyarrow as pa", "pa.ipc.open_stream(answer).read_all()"),
    "parquet": ("import io\n\nimport pyarrow.parquet as pq", "pq.read_table(io.BytesIO(answer.read()))"),
    "csv": ("import pyarrow.csv", "pyarrow.csv.read_csv(answer)"),
}
LEAST, MOST = "least.", "most."  # prefixes of the names of the fields of a range, before the column
MOST_OFFERED = 500  # campaigns to choose from
router = APIRouter(include_in_schema=False)


class SamplesShown(samples.SampleQuestion):
    """The samples of a page, and the columns over which they are drawn as dots."""

    x: str = Field("", max_length=200)
    y: str = Field("", max_length=200)


ShownSamples = Annotated[SamplesShown, Query()]


@router.get("/campaigns/{campaign}/samples")
async def samples_page(
    request: Request, service: TheService, campaign: TheCampaign, who: Authenticated, question: ShownSamples
) -> Response:
    """Show samples in a table, by default the worst first, and drawn over their columns; a sent form is redirected."""
    sent = request.query_params
    names = list(dict.fromkeys(key.partition(".")[2] for key in sent if key.startswith((LEAST, MOST))))
    kept = {key: value for key, value in question.model_dump(exclude_defaults=True).items() if value}
    is_part = request.headers.get("hx-request") == "true"
    home = f"/campaigns/{quote(campaign)}/samples"
    if names:
        ends = [(name, sent.get(LEAST + name, "").strip(), sent.get(MOST + name, "").strip()) for name in names]
        kept["range"] = [f"{name}:{low}:{high}" for name, low, high in ends[: samples.MOST_COLUMNS] if low or high]
        if not is_part:
            return RedirectResponse(_address(home, kept), 303)
    ranges = [each[:300] for each in kept.get("range", [])]
    asked = (question.sort, question.status or None, question.cursor, question.limit, ranges)
    ask = service.answers.ask
    found, fault = await or_fault(ask(who.name, queries.samples_answer, [campaign], *asked))
    cloud, _ = await or_fault(ask(who.name, queries.cloud_answer, [campaign], ranges))
    ends_of = {name: (low, high) for name, low, high in (text.rsplit(":", 2) for text in ranges if text.count(":") > 1)}
    kept = {key: value for key, value in kept.items() if key != "cursor" and value}
    values: dict[str, Any] = {"question": question, "found": found, "fault": fault, "kept": kept, "ends": ends_of}
    values |= {"sorts": SORTS, "statuses": STATUSES, "cloud": cloud, "least": LEAST, "most": MOST}
    values |= {
        "lines": cloud and parallel_figure(cloud, ends_of),
        "dots": cloud and dots_figure(cloud, question.x, question.y),
    }
    answer = page(request, "samples", **values, **await frame(request, service, campaign, who))
    if is_part:
        answer.headers["HX-Replace-Url"] = _address(home, kept)
    return answer


def _address(home: str, asked: Mapping[str, Any]) -> str:
    """Return the address of a page with the parameters that are not empty."""
    query = urlencode(asked, doseq=True)
    return f"{home}?{query}" if query else home


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
