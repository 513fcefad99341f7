"""The samples of a campaign: one of them, its replay and motion; exports; what-if, advice and comparison.

The numbers are those of the command line, to the last bit.
"""

from typing import Annotated, Any

from fastapi import Path, Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import iterate_in_threadpool, run_in_threadpool
from starlette.responses import Response

from clearcap.questions import samples
from clearcap.questions.confirmation import confirm_in_store
from clearcap.questions.exported_rows import FORMATS, RowSelection, export_rows, rows_etag
from clearcap.questions.submissions import Capacity
from clearcap.web.access import Principal
from clearcap.web.http.authentication import (
    Authenticated,
    Engineer,
    OtherCampaign,
    OwnCampaign,
    TheCampaign,
    TheService,
    Viewer,
    the_campaign,
)
from clearcap.web.http.responses import CountedStream, Refusal, etag_response
from clearcap.web.jobs import queries
from clearcap.web.operations import Sent
from clearcap.web.operations.submissions import place_in_queue
from clearcap.web.web_service import Service

Setting = Annotated[str, Field(max_length=queries.LONGEST_SETTING)]
WhatIfSettings = Annotated[
    list[Setting], Query(max_length=queries.MOST_SETTINGS, description="VARIABLE.KEY=VALUE", examples=[["J1.std=0.01"]])
]
MOST_COLUMNS = 1000
JSON = "application/json"
ENDINGS = {"arrow": "arrows", "parquet": "parquet", "csv": "csv"}  # a stream of Arrow batches has the ending arrows
ON_A_PAGE, MOST_ON_A_PAGE = 50, 1000
Sample = Annotated[int, Path(ge=0, lt=2**53, description="Number of the sample", examples=[7])]


class RowsQuestion(BaseModel):
    """The format, rows and columns of an export."""

    format: str = Field("arrow", pattern="^(arrow|parquet|csv)$", examples=["parquet"])
    columns: list[str] = Field([], max_length=MOST_COLUMNS, description="Columns, in this order; all if absent")
    first: int | None = Field(None, ge=0, lt=2**53, description="Least sample", examples=[0])
    last: int | None = Field(None, ge=0, lt=2**53, description="Largest sample", examples=[999])
    status: list[str] = Field([], max_length=20, description="Statuses of runs; all if absent", examples=[["ok"]])


class SampleQuestion(BaseModel):
    """The filter, order and page of a list of samples."""

    sort: str = Field(
        "margin",
        min_length=1,
        max_length=200,
        description="`margin` (the worst first), `sample`, or a column; with `-` before it the largest first",
    )
    range: list[Annotated[str, Field(max_length=300)]] = Field(
        [], max_length=MOST_COLUMNS, description="COLUMN:LEAST:MOST; an end may be empty", examples=[["J1:0.06:"]]
    )
    status: str | None = Field(None, max_length=40, description="`ok`, `failed` or one failed status", examples=["ok"])
    cursor: int = Field(0, ge=0, le=10**9, description="From the page before")
    limit: int = Field(ON_A_PAGE, ge=1, le=MOST_ON_A_PAGE)


RowsQuery = Annotated[RowsQuestion, Query()]
SampleQuery = Annotated[SampleQuestion, Query()]


def show_sample(service: TheService, campaign: TheCampaign, sample: Sample) -> samples.StoredSample:
    """Show a sample: its variables, its responses, and its certificate."""
    found = samples.stored_sample(service.store, campaign, sample)
    if found is None:
        raise Refusal(404, f"sample {sample} of {campaign}: not computed yet, or its part is broken")
    return found


async def replay(service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample) -> samples.ReplayedSample:
    """Compute a sample again and compare it bit for bit with its row; return the document of `clearcap replay`."""
    store = service.store
    await run_in_threadpool(samples.plan_with, store, campaign, sample)
    content = await service.pool.data(who.name, samples.replay_document, store.files.full_url, campaign, sample)
    return samples.ReplayedSample.model_validate(content)


async def drawn(service: Service, campaign: str, who: Principal, sample: int, job: Any, *more: str) -> bytes:
    """Return what `draw_sample` or `sample_motion` makes of a sample, the motion as JSON; recent ones are cached."""
    store = service.store
    await run_in_threadpool(samples.plan_with, store, campaign, sample)
    return await service.answers.made(who.name, job, store.files.full_url, campaign, sample, *more)


async def export(
    request: Request, service: TheService, campaign: TheCampaign, who: Authenticated, question: RowsQuery
) -> Response:
    """Return rows as Arrow (a stream of batches), Parquet or CSV, in the order of the samples.

    Arrow and Parquet have units in the metadata of the columns. The file is generated while it is sent. The answer is
    304 if `If-None-Match` has the ETag of the rows.
    """
    kind = question.format
    selection = RowSelection(tuple(question.columns), question.first, question.last, tuple(question.status))
    tag = rows_etag(await service.answers.version(campaign), kind, selection)
    headers = {"ETag": tag, "Cache-Control": "private, no-cache"}
    if tag in [word.strip().removeprefix("W/") for word in request.headers.get("if-none-match", "").split(",")]:
        return Response(status_code=304, headers=headers)
    store = service.store
    plan = await run_in_threadpool(store.plan, campaign)
    pieces = await run_in_threadpool(export_rows, store, plan, kind, selection)
    headers["Content-Disposition"] = f'attachment; filename="{campaign}.{ENDINGS[kind]}"'
    return CountedStream(service, who, iterate_in_threadpool(pieces), FORMATS[kind], headers)


async def list_samples(
    request: Request, service: TheService, campaign: TheCampaign, who: Authenticated, question: SampleQuery
) -> Response:
    """List samples, by default with the smallest distance of a response from its limit first."""
    asked = (question.sort, question.status or None, question.cursor, question.limit, question.range)
    return etag_response(request, await service.answers.ask(who.name, queries.samples_answer, [campaign], *asked), JSON)


async def plot(request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample) -> Response:
    """Compute a sample again and draw its curves over time."""
    content = await drawn(service, campaign, who, sample, samples.draw_sample, "svg")
    return etag_response(request, content, "image/svg+xml")


async def motion_gif(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample
) -> Response:
    """Compute a sample again and draw its motion."""
    return etag_response(request, await drawn(service, campaign, who, sample, samples.draw_sample, "gif"), "image/gif")


async def motion_data(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample
) -> Response:
    """Compute a sample again and return its motion as data: outlines of the bodies and their places over time."""
    return etag_response(request, await drawn(service, campaign, who, sample, samples.sample_motion), JSON)


LONGEST_COSTS = 2**16  # characters
Preview = Annotated[bool, Query(description="For a large campaign, use only the first 100,000 samples, and say so")]


class WhatIfRequest(Sent):
    """A what-if question, which may be too long for a URL."""

    set: list[Setting] = Field(
        max_length=queries.MOST_SETTINGS, description="VARIABLE.KEY=VALUE", examples=[["J1.std=0.01"]]
    )
    preview: bool = Field(False, description="For a large campaign, use only the first 100,000 samples, and say so")


class CostRequest(Sent):
    """The costs of tolerances."""

    costs: str = Field(
        max_length=LONGEST_COSTS,
        description="The text of a cost file, TOML",
        examples=["target = 1.33\n\n[variables.J1]\nfixed = 1.0\ncost = 0.02\n"],
    )


class Confirmed(BaseModel):
    """What fresh runs say of the cheapest tolerances, so far."""

    campaign: str = Field(examples=["c60-0a1b2c3d4e"])
    store: str
    text: str = Field(examples=["confirmed by 865 fresh runs (c60-5e6f7a8b9c)"])
    confirmation: dict[str, Any] = Field(
        description="outcome (confirmed, missed, refused, computing), proposal and rounds, of `advise --confirm --json`"
    )


async def ask_what_if(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    set: WhatIfSettings,
    preview: Preview = False,
) -> Response:
    """Estimate the capability under other distributions; return the document of `clearcap whatif --json`."""
    found = await service.answers.ask(who.name, queries.what_if_answer, [campaign], set, preview)
    return etag_response(request, found, JSON)


async def post_what_if(
    request: Request, service: TheService, campaign: TheCampaign, who: Authenticated, wanted: WhatIfRequest
) -> Response:
    """Estimate the capability under many other distributions."""
    return await ask_what_if(request, service, campaign, who, wanted.set, wanted.preview)


async def ask_histogram(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    response: Annotated[str, Query(max_length=200, examples=["FC-1"])],
    set: WhatIfSettings = [],  # noqa: B006  # FastAPI copies it
    preview: Preview = False,
) -> Response:
    """Count the values of a response in bins, as sampled and under other distributions."""
    found = await service.answers.ask(who.name, queries.histogram_answer, [campaign], response, set, preview)
    return etag_response(request, found, JSON)


async def ask_advice(request: Request, service: TheService, campaign: TheCampaign, who: Authenticated) -> Response:
    """Advise which tolerances may grow and which must shrink; return the document of `clearcap advise --json`."""
    return etag_response(request, await service.answers.ask(who.name, queries.advice_answer, [campaign]), JSON)


async def ask_allocation(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, wanted: CostRequest
) -> Response:
    """Find the cheapest tolerances that keep every target; return the document of `clearcap advise --cost --json`."""
    found = await service.answers.ask(who.name, queries.allocation_answer, [campaign], wanted.costs)
    return etag_response(request, found, JSON)


async def confirm_allocation(
    service: TheService, campaign: OwnCampaign, who: Engineer, wanted: CostRequest
) -> Confirmed:
    """Judge the cheapest tolerances by fresh runs: queue the campaign of the next round, or return what all said."""
    capacity = Capacity(service.settings.limits.samples, service.settings.workers)
    arguments = service.store.files.full_url, campaign, wanted.costs, who.name, capacity
    async with place_in_queue(service, who):
        made: dict[str, Any] = await service.pool.data(who.name, confirm_in_store, *arguments)
    for each in made["confirmation"]["rounds"][-1:]:
        await service.watcher.list_campaigns(each["campaign"])
    return Confirmed.model_validate(made)


async def ask_comparison(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, other: OtherCampaign
) -> Response:
    """Compare two campaigns: means, sigmas and Cpk of each response, and their differences with intervals."""
    await the_campaign(service, who, other)
    return etag_response(
        request, await service.answers.ask(who.name, queries.comparison_answer, [campaign, other]), JSON
    )
