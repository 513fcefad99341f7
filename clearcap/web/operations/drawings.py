"""Mechanisms from STEP files: upload one, read what was found in it, and answer what the draft of a mechanism asks."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

from fastapi import Form, Request, UploadFile
from fastapi import Path as InPath
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from campaign.store.drawing_library import LARGEST_STEP, Draft, read_draft, read_page, save_draft
from campaign.store.mechanism_library import save_mechanism
from clearcap.questions import step_import
from clearcap.web.http.authentication import Engineer, TheService, Viewer
from clearcap.web.http.responses import Refusal, etag_response
from clearcap.web.jobs.process import JobLimits
from clearcap.web.operations import Sent, keep_upload
from clearcap.web.operations.mechanisms import LONGEST_TEXT, NAME, NameField
from clearcap.web.web_service import Service
from engine.mechanism import library_names

DraftName = Annotated[str, InPath(pattern=NAME, description="Of the mechanism", examples=["latch"])]
AcceptDamage = Annotated[bool, Form(description="Take what can be read of a damaged STEP file")]
# also of the process in which OCCT reads the file, which gets no more than is left to the job that starts it
LIMITS = JobLimits(processor_s=300.0, wall_s=600.0)
# the page of what was found runs its own script alone, which its own policy names by digest, and reaches nothing
PAGE_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:;"
    " base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)


class DraftSummary(BaseModel):
    """A draft of a mechanism from a STEP file."""

    name: str
    version: int = Field(examples=[1])
    file: str = Field(description="The STEP file, as it was uploaded", examples=["latch.step"])
    sha256: str = Field(description="Of the STEP file")
    by: str
    at: datetime


class DraftContent(DraftSummary):
    """A draft with its texts."""

    text: str = Field(description="Its mechanism file, TOML; lines that begin with #? ask what no CAD file says")
    campaign: str = Field(description="The campaign file of the limits of size in the STEP file; may be empty")


class DraftText(Sent):
    """The changed text of a draft."""

    text: str = Field(max_length=LONGEST_TEXT, description="TOML")
    version: int = Field(ge=1, lt=10**6, description="The version that was changed; 409 if there is a later one")


async def upload_step(
    service: TheService, who: Engineer, name: NameField, file: UploadFile, accept_damage: AcceptDamage = False
) -> dict[str, Any]:
    """Propose a mechanism from a STEP file and save it as a draft; an earlier draft of this name is brought to it."""
    if name in library_names():
        raise Refusal(409, f"{name} is a shipped mechanism; give yours another name")
    if (file.size or 0) > LARGEST_STEP:
        words = f"file: has more than {LARGEST_STEP // 2**20} MiB; export only the parts of the mechanism"
        raise Refusal(413, words)
    with TemporaryDirectory(prefix="clearcap-upload-") as folder:
        step = Path(folder, "upload.step")
        await run_in_threadpool(keep_upload, file, step)
        address, label = service.store.files.full_url, (file.filename or "upload.step")[:200]
        arguments = (address, Draft(name, "", label, "", "", who.name), step, accept_damage)
        found: dict[str, Any] = await service.pool.data(
            who.name, step_import.import_into_store, *arguments, limits=LIMITS
        )
    return {**found, "draft": _summary(await the_draft(service, name)).model_dump()}


async def the_draft(service: Service, name: str) -> Draft:
    """Return the newest version of a draft; refuse (404) other names."""
    found = await run_in_threadpool(read_draft, service.store, name)
    if found is None:
        raise Refusal(404, f"no draft {name}; upload its STEP file on the page of mechanisms")
    return found


def _summary(draft: Draft) -> DraftSummary:
    at = datetime.fromtimestamp(draft.at, UTC)
    return DraftSummary(name=draft.name, version=draft.version, file=draft.file, sha256=draft.step, by=draft.by, at=at)


async def show_draft(service: TheService, _: Viewer, name: DraftName) -> DraftContent:
    """Return the newest version of a draft."""
    draft = await the_draft(service, name)
    return DraftContent(**_summary(draft).model_dump(), text=draft.text, campaign=campaign_of(draft))


def campaign_of(draft: Draft) -> str:
    """Return the campaign file of a draft's limits of size, for the mechanism as it is saved in the store."""
    return draft.campaign.replace(f'mechanism = "{draft.name}.toml"', f'mechanism = "{draft.name}"')


async def found_page(request: Request, service: TheService, _: Viewer, name: DraftName) -> Response:
    """Return the page that shows in 3D what was found in the STEP file of a draft."""
    try:
        content = await run_in_threadpool(read_page, service.store, name)
    except FileNotFoundError as error:
        raise Refusal(404, f"no draft {name}; upload its STEP file on the page of mechanisms") from error
    frame = {"Content-Security-Policy": PAGE_POLICY, "X-Frame-Options": "SAMEORIGIN"}
    return etag_response(request, content, "text/html; charset=utf-8", frame)


async def check_draft(service: TheService, who: Engineer, name: DraftName, wanted: DraftText) -> dict[str, Any]:
    """Check the text of a draft; return its summary, warnings and open questions, or its faults as a problem."""
    draft = replace(await the_draft(service, name), text=wanted.text)
    address = service.store.files.full_url
    found: dict[str, Any] = await service.pool.data(who.name, step_import.check_draft, address, draft, limits=LIMITS)
    return found


async def keep_draft(service: TheService, who: Engineer, name: DraftName, wanted: DraftText) -> DraftSummary:
    """Save the text of a draft as a new version, with or without faults."""
    draft = replace(await the_draft(service, name), text=wanted.text, by=who.name, version=wanted.version)
    return _summary(await run_in_threadpool(save_draft, service.store, draft))


async def regroup_draft(service: TheService, who: Engineer, name: DraftName, wanted: DraftText) -> dict[str, Any]:
    """Save the text of a draft, and bring its bodies, joints and stops to its groups; return what that changes."""
    await keep_draft(service, who, name, wanted)
    draft = replace(await the_draft(service, name), by=who.name)
    arguments = (service.store.files.full_url, draft, None, True)  # its damage was accepted when it was uploaded
    found: dict[str, Any] = await service.pool.data(who.name, step_import.import_into_store, *arguments, limits=LIMITS)
    return {**found, "draft": _summary(await the_draft(service, name)).model_dump()}


async def save_drawn(service: TheService, who: Engineer, name: DraftName, wanted: DraftText) -> dict[str, Any]:
    """Save the text of a draft, and the mechanism of its plain numbers for campaigns; one with faults is refused."""
    checked = await check_draft(service, who, name, wanted)
    await keep_draft(service, who, name, wanted)
    saved = await run_in_threadpool(save_mechanism, service.store, name, checked.pop("text"), who.name)
    return {**checked, "mechanism": {"name": name, "version": saved.version}}
