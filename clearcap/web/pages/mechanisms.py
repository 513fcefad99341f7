"""The pages of mechanisms: a list with pictures, a page and an editor for each, and its try-out runs."""

import json
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any
from urllib.parse import quote, urlencode

from fastapi import APIRouter, Form, Query, Request, UploadFile
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError
from campaign.spec.result_columns import certificate_units
from campaign.store.drawing_library import drafts, read_draft
from campaign.store.mechanism_library import SavedMechanism, read_mechanism, saved_mechanisms
from clearcap.questions.mechanisms import MechanismSource, describe, titles, try_once, values_of
from clearcap.web.access import Principal, Role
from clearcap.web.http.authentication import Engineer, TheService, Viewer
from clearcap.web.http.responses import Refusal, etag_response, refusal_of
from clearcap.web.operations import drawings, mechanisms
from clearcap.web.operations.drawings import AcceptDamage, DraftName, DraftText
from clearcap.web.pages.rendering import QueryText, is_number, marked_lines, page, unix_lines, uploaded_text
from clearcap.web.web_service import Service
from engine import EngineError
from engine.cad_import.proposed_text import open_questions
from engine.mechanism import library_names, mechanism_schema

MOST_KEYS = 300  # keys that a page lists
router = APIRouter(include_in_schema=False)
FIELD = "value:"  # prefix of the names of the form's number fields
FREE_KEYS = 3  # rows of the form for any key
MOST_LISTED = 2000  # keys that a field proposes


@router.get("/mechanisms")
async def mechanisms_page(request: Request, service: TheService, who: Viewer) -> Response:
    """Show the mechanisms that campaigns may name."""
    saved = await run_in_threadpool(_saved_texts, service)
    shipped = [MechanismSource(name, mechanisms.shipped_text(name).decode()) for name in library_names()]
    own = [MechanismSource(each.name, each.text) for each in saved]
    found = json.loads(await service.answers.made(who.name, titles, shipped + own))
    drawn = await run_in_threadpool(drafts, service.store)
    return page(request, "mechanisms", shipped=library_names(), saved=saved, titles=found, drawn=drawn)


@router.post("/mechanisms")
async def upload_form(
    request: Request, service: TheService, who: Engineer, name: mechanisms.NameField, file: UploadFile
) -> Response:
    """Save an uploaded file as a mechanism; a file with faults is shown in the editor."""
    text = await uploaded_text(file, "file", "a mechanism is a TOML file")
    return await _edited(request, service, who, MechanismEdit(name, text, None, is_saved=True))


@router.post("/mechanisms/drawings")
async def upload_drawing(
    request: Request,
    service: TheService,
    who: Engineer,
    name: mechanisms.NameField,
    file: UploadFile,
    accept_damage: AcceptDamage = False,
) -> Response:
    """Propose a mechanism from an uploaded STEP file, and show the draft and what the file changed in it."""
    found = await drawings.upload_step(service, who, name, file, accept_damage)
    if not found["changes"]:
        return RedirectResponse(f"/mechanisms/{quote(name)}/drawing", 303)
    return await _drawn(request, service, name, changes=found["changes"])


@router.get("/mechanisms/{name}/drawing")
async def drawing_page(request: Request, service: TheService, _: Engineer, name: DraftName) -> Response:
    """Show what was found in a STEP file, and the draft of its mechanism with its open questions."""
    return await _drawn(request, service, name)


@router.post("/mechanisms/{name}/drawing")
async def drawing_form(
    request: Request,
    service: TheService,
    who: Engineer,
    name: DraftName,
    text: Annotated[str, Form(max_length=2 * mechanisms.LONGEST_TEXT)],
    version: Annotated[int, Form(ge=1, lt=10**6)],
    action: Annotated[str, Form(pattern="^(check|keep|groups|save)$")] = "check",
) -> Response:
    """Check the text of a draft, keep it, bring its bodies to its groups, or save its mechanism."""
    wanted = DraftText(text=unix_lines(text)[: mechanisms.LONGEST_TEXT], version=version)
    try:
        if action == "save":
            await drawings.save_drawn(service, who, name, wanted)
            return RedirectResponse(f"/mechanisms/{quote(name)}", 303)
        if action == "keep":
            await drawings.keep_draft(service, who, name, wanted)
            return RedirectResponse(f"/mechanisms/{quote(name)}/drawing", 303)
        if action == "groups":
            found = await drawings.regroup_draft(service, who, name, wanted)
            return await _drawn(request, service, name, changes=found["changes"])
        return await _drawn(
            request, service, name, wanted, checked=await drawings.check_draft(service, who, name, wanted)
        )
    except (CampaignError, EngineError, Refusal) as error:
        refusal = refusal_of(error)
        assert refusal is not None
        return await _drawn(request, service, name, wanted, refusal=refusal)


async def _drawn(
    request: Request,
    service: Service,
    name: str,
    sent: DraftText | None = None,
    *,
    checked: dict[str, Any] | None = None,
    changes: dict[str, Any] | None = None,
    refusal: Refusal | None = None,
) -> Response:
    """Return the page of a draft, with the text that was sent in place of the saved one."""
    draft = await drawings.the_draft(service, name)
    text, version = (sent.text, sent.version) if sent else (draft.text, draft.version)
    lines = marked_lines(text, refusal.faults if refusal else [])
    values: dict[str, Any] = {"draft": draft, "text": text, "version": version, "checked": checked, "lines": lines}
    values |= {"questions": open_questions(text), "changes": changes, "campaign": drawings.campaign_of(draft)}
    numbers = " ".join(str(line.number) for line in lines if line.faults)
    return page(request, "drawing", refusal=refusal, fault_lines=numbers, name=name, **values)


@router.get("/mechanisms/{name}")
async def mechanism_page(
    request: Request, service: TheService, who: Viewer, name: mechanisms.MechanismName, keys: QueryText = ""
) -> Response:
    """Show a mechanism: picture, numbers, benches, presets; only keys that contain the text `keys` are listed."""
    described = await described_mechanism(service, who, await mechanisms.source_of(service, name))
    listed = [each for each in described["keys"] if keys.lower() in each["key"].lower() or keys == each["short"]]
    if not keys:
        listed = [each for each in listed if each["short"] or each["key"].startswith("parameters.")]
    found = await run_in_threadpool(read_mechanism, service.store, name)
    values: dict[str, Any] = {"found": described, "listed": listed[:MOST_KEYS], "more": len(listed) - MOST_KEYS}
    values["draft"] = await run_in_threadpool(read_draft, service.store, name)
    return page(request, "mechanism", name=name, keys=keys, saved=found, **values)


@router.get("/schemas/mechanism.json")
def schema_document(request: Request, _: Viewer) -> Response:
    """Return the JSON Schema of mechanism files, which the editor uses to propose keys and values."""
    return etag_response(request, _schema(), "application/schema+json")


@router.get("/mechanisms/{name}/edit")
async def editor_page(request: Request, service: TheService, who: Engineer, name: mechanisms.MechanismName) -> Response:
    """Show the text of a mechanism in the editor; a shipped one must be saved under another name."""
    if name in library_names():
        return _editor(request, name, MechanismEdit("", mechanisms.shipped_text(name).decode(), 0))
    found = await run_in_threadpool(read_mechanism, service.store, name)
    if found is None:
        raise Refusal(404, f"no mechanism {name}")
    return _editor(request, name, MechanismEdit(name, found.text, found.version))


@router.post("/mechanisms/{name}/edit")
async def editor_form(
    request: Request,
    service: TheService,
    who: Engineer,
    name: mechanisms.MechanismName,
    text: Annotated[str, Form(max_length=2 * mechanisms.LONGEST_TEXT)],
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
        wanted = mechanisms.MechanismText(text=edit.text[: mechanisms.LONGEST_TEXT], version=edit.version)
        if not edit.is_saved:
            return _editor(request, name, edit, checked=await mechanisms.check_mechanism(service, who, wanted))
        check_name(edit.save_as)
        await mechanisms.save(service, who, edit.save_as, wanted)
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
    """Return the description of a mechanism, see `clearcap.questions.mechanisms.describe`; recent ones are cached."""
    content: dict[str, Any] = json.loads(await service.answers.made(who.name, describe, source))
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


@router.get("/mechanisms/{name}/try")
async def try_out_page(
    request: Request,
    service: TheService,
    who: Viewer,
    name: mechanisms.MechanismName,
    set: Annotated[list[str] | None, Query(max_length=mechanisms.MOST_VALUES)] = None,
    bench: QueryText = "",
    preset: QueryText = "",
    run: bool = False,
) -> Response:
    """Show the form and, with `run` or `set`, the results of the run, so that every run has its own URL."""
    if "was" in request.query_params:  # the form was sent
        typed = await _typed(request, service, who, name)
        more = [("bench", bench), ("preset", preset), ("run", "true")]
        asked = urlencode([*typed, *((key, value) for key, value in more if value)])
        return RedirectResponse(f"/mechanisms/{quote(name)}/try?{asked}", 303)
    found = await described_mechanism(service, who, await mechanisms.source_of(service, name))
    tried, refusal, values = None, None, {}
    try:
        values = values_of(set or [])
        on_bench = await mechanisms.source_of(service, name, bench=bench or None, preset=preset or None)
        found = await described_mechanism(service, who, on_bench)
        if (run or values) and who.may(Role.ENGINEER):
            tried = json.loads(await service.answers.made(who.name, try_once, replace(on_bench, values=values)))
    except (CampaignError, EngineError, Refusal) as error:
        refusal = refusal_of(error)
        assert refusal is not None
    settings = [("set", f"{key}={value!r}") for key, value in values.items()]
    question = urlencode([*settings, *((k, v) for k, v in (("bench", bench), ("preset", preset)) if v)])
    sliders = [_slider(each, values) for each in found["keys"] if each["short"]]
    named = {slider["key"] for slider in sliders}
    others = [(key, value) for key, value in values.items() if key not in named][: mechanisms.MOST_VALUES]
    shown: dict[str, Any] = {"name": name, "found": found, "bench": bench, "preset": preset, "tried": tried}
    shown |= {"sliders": sliders, "others": [*others, *[("", "")] * FREE_KEYS], "question": question, "field": FIELD}
    proposed = [each["key"] for each in found["keys"]][:MOST_LISTED]
    shown |= {"proposed": proposed, "certificate_units": certificate_units(found["units"])}
    return page(request, "try_out", refusal=refusal, **shown)


async def _typed(request: Request, service: Service, who: Principal, name: str) -> list[tuple[str, str]]:
    """Return the values typed into the form as pairs for the URL, without those that the form showed before."""
    asked = request.query_params
    found = await described_mechanism(
        service, who, await mechanisms.source_of(service, name, preset=asked["was"] or None)
    )
    shown = {each["short"]: each["value"] for each in found["keys"] if each["short"]}
    pairs = [(key.removeprefix(FIELD), text) for key, text in asked.multi_items() if key.startswith(FIELD)]
    free = zip(asked.getlist("free-key"), asked.getlist("free-value"), strict=False)
    typed = [(key.strip(), text.strip()) for key, text in [*pairs, *free][: mechanisms.MOST_VALUES]]
    return [("set", f"{key}={text}") for key, text in typed if key and text and not is_number(text, shown.get(key))]


def _slider(entry: dict[str, Any], values: dict[str, float]) -> dict[str, Any]:
    """Return the slider of a clearance, from 1 % of its upper end to twice the value, within the limits."""
    value = values.get(entry["short"], values.get(entry["key"], entry["value"]))
    high = max(2.0 * entry["value"], value)
    high = min(high, entry["upper"]) if entry["upper"] is not None else high
    low = max(high / 100.0, entry["lower"] or 0.0)
    return {
        "key": entry["short"],
        "value": value,
        "unit": entry["unit"],
        "low": low,
        "high": high,
        "own": entry["value"],
    }
