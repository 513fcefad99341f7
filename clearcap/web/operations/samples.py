"""The samples of a campaign: questions about them, a stored one, its replay and its motion."""

from typing import Annotated, Any

from fastapi import Path, Query
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from clearcap.questions.samples import (
    ReplayedSample,
    StoredSample,
    plan_with,
    replay_document,
    stored_sample,
)
from clearcap.web.access import Principal
from clearcap.web.answers.query_service import LONGEST_SETTING, MOST_SETTINGS
from clearcap.web.http.authentication import TheCampaign, TheService, Viewer
from clearcap.web.http.problems import Refusal
from clearcap.web.web_service import Service

Setting = Annotated[str, Field(max_length=LONGEST_SETTING)]
WhatIfSettings = Annotated[
    list[Setting], Query(max_length=MOST_SETTINGS, description="VARIABLE.KEY=VALUE", examples=[["J1.std=0.01"]])
]
MOST_COLUMNS = 1000
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

    sort: str = Field("margin", pattern="^(margin|sample)$", description="`margin`: the worst first")
    status: str | None = Field(None, max_length=40, description="`ok`, `failed` or one failed status", examples=["ok"])
    cursor: int = Field(0, ge=0, le=10**9, description="From the page before")
    limit: int = Field(ON_A_PAGE, ge=1, le=MOST_ON_A_PAGE)


def show_sample(service: TheService, campaign: TheCampaign, sample: Sample) -> StoredSample:
    """Show a sample: its variables, its responses, and its certificate."""
    found = stored_sample(service.store, campaign, sample)
    if found is None:
        raise Refusal(404, f"sample {sample} of {campaign}: not computed yet, or its part is broken")
    return found


async def replay(service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample) -> ReplayedSample:
    """Compute a sample again and compare it bit for bit with its row; return the document of `clearcap replay`."""
    store = service.store
    await run_in_threadpool(plan_with, store, campaign, sample)
    content = await service.pool.data(who.name, replay_document, store.files.full_url, campaign, sample)
    return ReplayedSample.model_validate(content)


async def drawn(service: Service, campaign: str, who: Principal, sample: int, job: Any, *more: str) -> bytes:
    """Return what `draw_sample` or `sample_motion` makes of a sample, the motion as JSON; recent ones are cached."""
    store = service.store
    await run_in_threadpool(plan_with, store, campaign, sample)
    return await service.kept(who.name, job, store.files.full_url, campaign, sample, *more)
