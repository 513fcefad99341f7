"""Calls for the reports of a campaign: its own, and its comparisons with other campaigns."""

import re
from typing import Annotated, Any

from fastapi import Path, Request
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from campaign.store.files.files import TEMPORARY
from campaign.store.store import comparisons, report_folder
from clearcap.questions.report import written_report
from clearcap.web.api.calls import PATTERN, TheCampaign, calls, the_campaign
from clearcap.web.http.authentication import Asking, Engineer, TheService
from clearcap.web.http.problems import Refusal, described
from clearcap.web.http.responses import TAGGED, tagged
from clearcap.web.web_service import Service

router = calls("reports")
TYPES = {
    "html": "text/html; charset=utf-8",
    "json": "application/json",
    "parquet": "application/vnd.apache.parquet",
    "pdf": "application/pdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "svg": "image/svg+xml",
    "png": "image/png",
}
# policy of a report's page: it runs nothing, loads nothing, and only this server's pages show it in a frame
REPORT_POLICY = (
    "sandbox allow-popups; default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none';"
    " form-action 'none'; frame-ancestors 'self'"
)
FILE_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"
FileName = Annotated[str, Path(pattern=FILE_NAME, examples=["report.html"])]
_FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {kind.partition(";")[0]: {} for kind in [*TYPES.values(), "application/octet-stream"]}}
}


class ReportFiles(BaseModel):
    """The files of a campaign's reports."""

    files: list[str] = Field(description="Of its own report; empty if none is written", examples=[["report.html"]])
    comparisons: dict[str, list[str]] = Field(description="Of its comparisons, by the id of the other campaign")


@router.get("/campaigns/{campaign}/reports", responses=described(404))
def report_files(service: TheService, campaign: TheCampaign, who: Asking) -> ReportFiles:
    """List the files of a campaign's report and of its comparisons with campaigns that you may see."""
    names = service.store.files.names(report_folder(campaign))
    others = comparisons(service.store, campaign)
    seen = {other: _written(files) for other, files in others.items() if who.may_see(other)}
    return ReportFiles(files=_written(names), comparisons=seen)


@router.post("/campaigns/{campaign}/report", responses=described(404, 409))
async def write_report(service: TheService, campaign: TheCampaign, who: Engineer) -> ReportFiles:
    """Write the report of a campaign again from the present rows; refused if the campaign is signed."""
    if service.is_signed(campaign):
        raise Refusal(409, f"campaign {campaign} is signed, and its report with it; it is not written again")
    await service.pool.data(who.name, written_report, service.store.files.full_url, campaign)
    service.watcher.hurry(campaign)
    return await run_in_threadpool(report_files, service, campaign, who)


@router.post("/campaigns/{campaign}/comparisons/{other}", responses=described(404, 409))
async def write_comparison(
    service: TheService,
    campaign: TheCampaign,
    who: Engineer,
    other: Annotated[str, Path(pattern=PATTERN, description="Id of the other campaign")],
) -> ReportFiles:
    """Write the report that compares a campaign with another."""
    await the_campaign(service, who, other)
    await service.pool.data(who.name, written_report, service.store.files.full_url, campaign, other)
    return await run_in_threadpool(report_files, service, campaign, who)


@router.get(
    "/campaigns/{campaign}/reports/own/{name}",
    response_class=Response,
    responses={**_FILE, **described(*TAGGED, 404)},
)
async def report_file(request: Request, service: TheService, campaign: TheCampaign, name: FileName) -> Response:
    """Return a file of a campaign's report, whole or in parts."""
    return await _file(request, service, report_folder(campaign), name)


@router.get(
    "/campaigns/{campaign}/reports/against/{other}/{name}",
    response_class=Response,
    responses={**_FILE, **described(*TAGGED, 404)},
)
async def comparison_file(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Asking,
    other: Annotated[str, Path(pattern=PATTERN, description="Id of the other campaign")],
    name: FileName,
) -> Response:
    """Return a file of a comparison, whole or in parts, to users who may see both campaigns."""
    if not who.may_see(other):
        raise Refusal(404, f"no campaign {other} in the store")
    return await _file(request, service, report_folder(campaign, other), name)


def _written(names: list[str]) -> list[str]:
    """Return the names of a report's files, without other files that may lie in its folder."""
    return [name for name in names if re.fullmatch(FILE_NAME, name) and not name.endswith(TEMPORARY)]


async def _file(request: Request, service: Service, folder: str, name: str) -> Response:
    """Return a file of a report."""
    kind = TYPES.get(name.rpartition(".")[2], "application/octet-stream")
    try:
        content = await run_in_threadpool(service.store.files.read, f"{folder}/{name}")
    except FileNotFoundError as error:
        raise Refusal(404, f"{folder}: has no file {name}; write the report first") from error
    frame = {"Content-Security-Policy": REPORT_POLICY, "X-Frame-Options": "SAMEORIGIN"}
    return tagged(request, content, kind, frame)
