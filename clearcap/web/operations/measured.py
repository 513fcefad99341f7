"""Measured parts: send a table with its limits, read the report that is made of them, delete them."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

from fastapi import Form, Query, Request, Response, UploadFile
from fastapi import Path as InPath
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from campaign.store.measured_library import (
    FOLDER,
    LARGEST_PARTS,
    NAME,
    MeasuredParts,
    measured_parts,
    place,
    read_parts_record,
    remove_parts,
)
from campaign.store.monitored_library import Monitored, read_monitored
from clearcap.questions.monitoring import monitor_in_store
from clearcap.questions.submissions import Capacity
from clearcap.questions.uploaded_parts import report_into_store
from clearcap.web.access import Principal, Role
from clearcap.web.http.authentication import Engineer, OwnCampaign, TheCampaign, TheService, Viewer
from clearcap.web.http.responses import Refusal
from clearcap.web.operations import keep_upload
from clearcap.web.operations.campaigns import FileName, file_answer
from clearcap.web.operations.submissions import place_in_queue
from clearcap.web.web_service import Service
from engine.platform.toml_file import LARGEST

PartsName = Annotated[str, InPath(pattern=NAME, description="Id of the measured parts", examples=["lever-0a1b2c3d4e"])]
CURSOR = r"^\d{1,12}(\.\d{1,20})? [A-Za-z0-9][A-Za-z0-9_-]{0,99}$"
PartsCursor = Annotated[str | None, Query(pattern=CURSOR, max_length=150, description="From the page before")]


class PartsListing(BaseModel):
    """A page of the list of measured parts, the newest first."""

    measured: list[MeasuredParts]
    total: int = Field(description="Tables in the store", examples=[1])
    next: str | None = Field(description="Cursor of the next page; null on the last one")


def list_parts(
    service: TheService, _: Viewer, cursor: PartsCursor = None, limit: Annotated[int, Query(ge=1, le=100)] = 50
) -> PartsListing:
    """List the measured parts that were sent, with what their reports say."""
    found = measured_parts(service.store)
    rest = found
    if cursor is not None:
        at, name = cursor.split(" ")
        rest = [each for each in found if place(each) < (float(at), name)]
    last = rest[limit - 1] if len(rest) > limit else None
    following = None if last is None else f"{last.at!r} {last.id}"
    return PartsListing(measured=rest[:limit], total=len(found), next=following)


@asynccontextmanager
async def _kept(file: UploadFile, limits: UploadFile | None) -> AsyncIterator[tuple[Path, Path | None]]:
    """Have a table and its limits in files for a job; refuse (413) large ones."""
    sizes = {"file": (file.size or 0, LARGEST_PARTS), "limits": (0 if limits is None else limits.size or 0, LARGEST)}
    for key, (size, most) in sizes.items():
        if size > most:
            raise Refusal(413, f"{key}: has {size} bytes; allowed: up to {most}; send fewer parts at a time")
    with TemporaryDirectory(prefix="clearcap-upload-") as folder:
        table, text = Path(folder, "table"), Path(folder, "limits")
        await run_in_threadpool(keep_upload, file, table)
        if limits is not None:
            await run_in_threadpool(keep_upload, limits, text)
        yield table, None if limits is None else text


async def upload_parts(
    service: TheService, who: Engineer, response: Response, file: UploadFile, limits: UploadFile
) -> MeasuredParts:
    """Make the capability report of measured parts from a table and its limits file, and keep all of it."""
    async with _kept(file, limits) as (table, text):
        address, label = service.store.files.full_url, file.filename or ""
        made: dict[str, Any] = await service.pool.data(
            who.name, report_into_store, address, table, label, text, who.name
        )
    if not made["is_new"]:
        response.status_code = 200
    return MeasuredParts.model_validate(made["parts"])


async def monitor(
    service: TheService,
    campaign: OwnCampaign,
    who: Engineer,
    file: UploadFile,
    limits: UploadFile | None = None,
    rerun: Annotated[bool, Form(description="Compute what the rows do not answer, as a campaign of its own")] = False,
) -> Monitored:
    """Give a campaign's variables the distributions of measured parts; say which index falls below its requirement."""
    settings, address = service.settings, service.store.files.full_url
    capacity = Capacity(settings.limits.samples, settings.workers)
    async with AsyncExitStack() as entered:
        table, text = await entered.enter_async_context(_kept(file, limits))
        if rerun:
            await entered.enter_async_context(place_in_queue(service, who))
        arguments = address, campaign, table, file.filename or "", text, who.name, rerun, capacity
        made: dict[str, Any] = await service.pool.data(who.name, monitor_in_store, *arguments)
    found = Monitored.model_validate(made)
    for changed in filter(None, (campaign, found.campaign)):
        await service.watcher.list_campaigns(changed)
    return found


async def show_monitored(service: TheService, campaign: TheCampaign) -> Monitored:
    """Show what the last measured parts said of a campaign."""
    found = await run_in_threadpool(read_monitored, service.store, campaign)
    if found is None:
        raise Refusal(404, f"{campaign}: no measured parts were looked at; send some")
    return found


async def show_parts(service: TheService, _: Viewer, measured: PartsName) -> MeasuredParts:
    """Show whose measured parts they are, and what their report says."""
    found = await run_in_threadpool(read_parts_record, service.store, measured)
    if found is None:
        raise Refusal(404, f"no measured parts {measured}; the list has what there is")
    return found


async def parts_file(
    request: Request, service: TheService, who: Viewer, measured: PartsName, name: FileName
) -> Response:
    """Return a file of measured parts, whole or in parts: of their report, the table, or its limits."""
    await show_parts(service, who, measured)
    return await file_answer(request, service, f"{FOLDER}/{measured}", name)


def files_of_parts(service: Service, measured: str) -> list[str]:
    """Return the names of the files of measured parts."""
    return service.store.files.names(f"{FOLDER}/{measured}")


def may_delete(parts: MeasuredParts, who: Principal) -> bool:
    """Return whether a user may delete measured parts: who sent them, and admins."""
    return who.may(Role.ADMIN) or (who.may(Role.ENGINEER) and parts.by == who.name)


async def delete_parts(service: TheService, who: Engineer, measured: PartsName) -> None:
    """Delete measured parts that you have sent, with their report; admins delete all."""
    found = await show_parts(service, who, measured)
    if not may_delete(found, who):
        raise Refusal(403, f"{measured} was sent by {found.by}; only {found.by} and admins may delete it")
    await run_in_threadpool(remove_parts, service.store, measured)
