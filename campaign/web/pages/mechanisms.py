"""The pages of mechanisms: a list with pictures, and a page and an editor for each."""

import json
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Form, Query, Request, UploadFile
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError
from campaign.store.mechanism_library import SavedMechanism, read_mechanism, saved_mechanisms
from campaign.web.access import Principal
from campaign.web.api.mechanisms import (
    LONGEST_TEXT,
    MechanismName,
    MechanismText,
    check_mechanism,
    save,
    shipped_text,
    source_of,
)
from campaign.web.http.asking import Engineer, TheService, Viewer
from campaign.web.http.problems import Refusal, refusal_of
from campaign.web.http.tagged import tagged
from campaign.web.jobs.mechanisms import MechanismSource, describe, titles
from campaign.web.pages.marked_text import marked_lines, unix_lines
from campaign.web.pages.rendering import page
from campaign.web.web_service import Service
from engine import EngineError
from engine.mechanism import library_names, mechanism_schema

router = APIRouter(include_in_schema=False)
MOST_KEYS = 300  # keys that a page lists
NameField = Annotated[str, Form(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]


@router.get("/mechanisms")
async def mechanisms_page(request: Request, service: TheService, who: Viewer) -> Response:
    """Show the mechanisms that campaigns may name."""
    saved = await run_in_threadpool(_saved_texts, service)
    shipped = [MechanismSource(name, shipped_text(name).decode()) for name in library_names()]
    own = [MechanismSource(each.name, each.text) for each in saved]
    said = json.loads(await service.kept(who.name, titles, shipped + own))  # type: ignore[arg-type]  # JSON of a dict
    return page(request, "mechanisms", shipped=library_names(), saved=saved, titles=said)


@router.post("/mechanisms")
async def upload_form(
    request: Request, service: TheService, who: Engineer, name: NameField, file: UploadFile
) -> Response:
    """Save an uploaded file as a mechanism; a file with faults is shown in the editor."""
    content = await file.read(LONGEST_TEXT + 1)
    try:
        text = unix_lines(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise Refusal(422, f"file: is not UTF-8 text ({error.reason} at byte {error.start})") from error
    if len(content) > LONGEST_TEXT:
        raise Refusal(422, f"file: has more than {LONGEST_TEXT} bytes; a mechanism is a TOML file")
    return await _edited(request, service, who, MechanismEdit(name, text, None, is_saved=True))


@router.get("/mechanisms/{name}")
async def mechanism_page(
    request: Request,
    service: TheService,
    who: Viewer,
    name: MechanismName,
    keys: Annotated[str, Query(max_length=100)] = "",
) -> Response:
    """Show a mechanism: picture, numbers, benches, presets; only keys that contain the text `keys` are listed."""
    described = await described_mechanism(service, who, await source_of(service, name))
    listed = [each for each in described["keys"] if keys.lower() in each["key"].lower() or keys == each["short"]]
    if not keys:
        listed = [each for each in listed if each["short"] or each["key"].startswith("parameters.")]
    found = await run_in_threadpool(read_mechanism, service.store, name)
    values: dict[str, Any] = {
        "name": name,
        "found": described,
        "listed": listed[:MOST_KEYS],
        "more": len(listed) - MOST_KEYS,
    }
    return page(request, "mechanism", keys=keys, saved=found, **values)


@router.get("/schemas/mechanism.json")
def schema_document(request: Request, _: Viewer) -> Response:
    """Return the JSON Schema of mechanism files, which the editor uses to propose keys and values."""
    return tagged(request, _schema(), "application/schema+json")


@router.get("/mechanisms/{name}/edit")
async def editor_page(request: Request, service: TheService, who: Engineer, name: MechanismName) -> Response:
    """Show the text of a mechanism in the editor; a shipped one must be saved under another name."""
    if name in library_names():
        return _editor(request, name, MechanismEdit("", shipped_text(name).decode(), 0))
    found = await run_in_threadpool(read_mechanism, service.store, name)
    if found is None:
        raise Refusal(404, f"no mechanism {name}")
    return _editor(request, name, MechanismEdit(name, found.text, found.version))


@router.post("/mechanisms/{name}/edit")
async def editor_form(
    request: Request,
    service: TheService,
    who: Engineer,
    name: MechanismName,
    text: Annotated[str, Form(max_length=2 * LONGEST_TEXT)],
    action: Annotated[str, Form(pattern="^(check|save)$")] = "check",
    save_as: Annotated[str, Form(max_length=64)] = "",
    version: Annotated[int, Form(ge=0, lt=10**6)] = 0,
) -> Response:
    """Check a text, or save it as a new version."""
    seen = version if save_as == name else None  # another name has versions of its own
    edit = MechanismEdit(save_as, unix_lines(text), seen, is_saved=action == "save")
    return await _edited(request, service, who, edit, name)


@dataclass(frozen=True)
class MechanismEdit:
    """The text of a mechanism that a user has edited, and what to do with it."""

    save_as: str
    text: str
    version: int | None  # newest version that the user has seen; None if that does not matter
    is_saved: bool = False  # save the text if it has no faults; otherwise it is only checked


async def _edited(request: Request, service: Service, who: Principal, edit: MechanismEdit, name: str = "") -> Response:
    """Save or check a text, and show the result."""
    try:
        wanted = MechanismText(text=edit.text[:LONGEST_TEXT], version=edit.version)
        if not edit.is_saved:
            return _editor(request, name, edit, checked=await check_mechanism(service, who, wanted))
        check_name(edit.save_as)
        await save(service, who, edit.save_as, wanted)
    except (CampaignError, EngineError, Refusal) as error:
        refusal = refusal_of(error)
        assert refusal is not None
        return _editor(request, name or edit.save_as, edit, refusal=refusal)
    return RedirectResponse(f"/mechanisms/{quote(edit.save_as)}", 303)


def check_name(name: str) -> None:
    """Raise Refusal (422) for an invalid name of a mechanism."""
    if not name or not name.isascii() or not name.replace("_", "a").replace("-", "a").isalnum() or name[0] in "-_":
        raise Refusal(422, f"name {name!r:.80}: give one of letters, digits, - and _, the first a letter or digit")


def _editor(
    request: Request,
    name: str,
    edit: MechanismEdit,
    checked: dict[str, Any] | None = None,
    refusal: Refusal | None = None,
) -> Response:
    """Return the page of the editor, with each fault beside its line."""
    faults = refusal.faults if refusal else []
    lines = marked_lines(edit.text, faults)
    values: dict[str, Any] = {"name": name, "edit": edit, "checked": checked, "lines": lines}
    numbers = " ".join(str(line.number) for line in lines if line.faults)
    return page(request, "mechanism_editor", refusal=refusal, fault_lines=numbers, **values)


async def described_mechanism(service: Service, who: Principal, source: MechanismSource) -> dict[str, Any]:
    """Return the description of a mechanism, see `campaign.web.jobs.mechanisms.describe`; recent ones are cached."""
    content: dict[str, Any] = json.loads(await service.kept(who.name, describe, source))  # type: ignore[arg-type]
    return content


@cache
def _schema() -> bytes:
    """Return the JSON Schema of mechanism files."""
    return json.dumps(mechanism_schema(), ensure_ascii=False, separators=(",", ":")).encode()


def _saved_texts(service: Service) -> list[SavedMechanism]:
    """Return the newest version of each saved mechanism."""
    store = service.store
    found = (read_mechanism(store, name, version) for name, version in saved_mechanisms(store).items())
    return [each for each in found if each is not None]
