"""The page for a new campaign: a form beside the text of its file, each derived from the other."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError
from campaign.inputs.distributions import DISTRIBUTIONS
from campaign.inputs.sampling import SAMPLERS
from campaign.spec.named_files import MOST_FILES
from campaign.store.labels import MOST_TAGS
from campaign.store.layout import PLAN
from campaign.store.mechanism_library import saved_mechanisms
from clearcap.web.access import Principal
from clearcap.web.http.authentication import CAMPAIGN_ID, Engineer, TheService
from clearcap.web.http.problems import Refusal, refusal_of
from clearcap.web.operations.mechanisms import LONGEST_TEXT
from clearcap.web.operations.samples import WhatIfSettings
from clearcap.web.operations.submissions import CampaignRequest, source_of_request, submit
from clearcap.web.pages.campaign_form import (
    LIMITS,
    PARAMETERS,
    STATISTICS,
    STOP_NUMBERS,
    TOP_KEYS,
    Tables,
    composed,
    first_text,
    started_from,
)
from clearcap.web.pages.rendering import fault_line, marked_lines, page, unix_lines
from clearcap.web.web_service import Service
from engine.mechanism import library_names

DEFAULT = "truncated_normal"
BLANK_ROWS = 2  # rows for further variables
MOST_ROWS = 1000
NO_MECHANISM: Tables = {"responses": {}, "keys": [], "benches": {}, "presets": {}}
_WHOLE = ("samples", "seed", "min_samples", "max_samples")
_TEXTS = ("name", "title", "mechanism", "bench", "preset", "sampler", "distribution", "target", "response", "statistic")
router = APIRouter(include_in_schema=False)
FIRST_MECHANISM = "c60"
ACTIONS = ("write", "read", "check", "try", "submit")
BOTH_CHANGED = (
    "form and file have both changed since one was made from the other: press Write the file to take the form, or Read"
    " the file to take the file"
)


@dataclass(frozen=True)
class FormField:
    """One field of the form."""

    name: str  # in the form, which is also its id in the page
    key: str  # last key in the campaign file
    value: str
    faults: tuple[str, ...] = ()  # of its value
    hint: str = ""  # description of the key


def tables_of(sent: Mapping[str, str]) -> Tables:
    """Return the campaign's tables from a sent form.

    The fields of row ``i`` are named ``v{i}.KEY`` for variables and ``r{i}.KEY`` for responses; the fields of the
    stopping rule are named ``stop.KEY``.
    """
    tables: Tables = {key: value for key in TOP_KEYS if (value := _typed(key, sent.get(key, ""))) != ""}
    for letter, table in (("v", "variables"), ("r", "responses")):
        tables[table] = {}
        for row in _rows(sent, letter):
            name = row.pop("name", "").strip()
            if name:
                known = _known_keys(row) if letter == "v" else {*LIMITS}
                values = {key: _typed(key, text) for key, text in row.items() if key in known and text.strip()}
                tables[table][name] = values
    stop = {key: _typed(key, sent.get(f"stop.{key}", "")) for key in ("response", "statistic", *STOP_NUMBERS)}
    tables["stop"] = {key: value for key, value in stop.items() if value != ""} if stop["response"] else {}
    return tables


def digest(content: Any) -> str:
    """Return a digest of a text or of the tables of a form, which shows whether they have changed."""
    text = content if isinstance(content, str) else json.dumps(content, sort_keys=True)
    return sha256(text.encode(errors="replace")).hexdigest()[:16]


class CampaignForm:
    """The fields of a campaign's form, with the faults of each."""

    def __init__(self, tables: Tables, faults: Sequence[Mapping[str, Any]], found: Mapping[str, Any]) -> None:
        self._faults = [(tuple(each["keys"]), fault_line(each)) for each in faults if not each.get("file")]
        self._tables, self._known = tables, found.get("mechanism") or NO_MECHANISM
        self.top = {key: self._field(key, (key,), tables.get(key)) for key in TOP_KEYS}
        self.variables = list(self._variables(found.get("densities") or {}))
        self.responses = list(self._responses())
        self.stop = {
            key: self._field(f"stop.{key}", ("stop", key), tables.get("stop", {}).get(key), STOP_NUMBERS.get(key, ""))
            for key in ("response", "statistic", *STOP_NUMBERS)
        }
        self.mechanism = self._known

    def _variables(self, densities: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        """Yield the rows of the variables, and some blank rows."""
        blank = [("", {"distribution": DEFAULT})] * BLANK_ROWS
        for i, (name, table) in enumerate([*self._tables.get("variables", {}).items(), *blank]):
            kind = str(table.get("distribution", DEFAULT))
            keys = ("variables", name)
            parameters = [
                self._field(f"v{i}.{key}", (*keys, key), table.get(key), hint)
                for key, hint in PARAMETERS.get(kind, {}).items()
            ]
            named = {"distribution", "target", *PARAMETERS.get(kind, {})}
            rest = [text for at, text in self._faults if name and at[:2] == keys and (at[2:3] or ("",))[0] not in named]
            yield {
                "name": FormField(f"v{i}.name", "name", name, tuple(rest)),
                "distribution": self._field(f"v{i}.distribution", (*keys, "distribution"), kind),
                "target": self._field(f"v{i}.target", (*keys, "target"), table.get("target")),
                "parameters": parameters,
                "density": densities.get(name) if name else None,
            }

    def _responses(self) -> Iterator[dict[str, Any]]:
        """Yield the rows of the responses: those of the mechanism, then others that the file names."""
        given, known = self._tables.get("responses", {}), self._known["responses"]
        for i, name in enumerate([*known, *(name for name in given if name not in known)]):
            keys, table = ("responses", name), given.get(name, {})
            limits = [self._field(f"r{i}.{key}", (*keys, key), table.get(key), hint) for key, hint in LIMITS.items()]
            own = tuple(text for at, text in self._faults if at[:2] == keys and (at[2:3] or ("",))[0] not in LIMITS)
            about = known.get(name, {"title": "", "unit": ""})
            yield {"name": FormField(f"r{i}.name", "name", name, own), "limits": limits, **about}

    def _field(self, name: str, keys: tuple[str, ...], value: Any, hint: str = "") -> FormField:
        """Return a field with the faults of its key."""
        faults = tuple(text for at, text in self._faults if at == keys or (len(keys) == 1 and at[: len(keys)] == keys))
        return FormField(name, keys[-1], "" if value is None else str(value), faults, hint)


def _rows(sent: Mapping[str, str], letter: str) -> Iterator[dict[str, str]]:
    """Yield the fields of each row of a table, by key."""
    rows: dict[int, dict[str, str]] = {}
    for name, text in sent.items():
        place, _, key = name.partition(".")
        if place[:1] == letter and place[1:].isdecimal() and len(place) < 6 and key:
            rows.setdefault(int(place[1:]), {})[key] = text
    for _, row in sorted(rows.items())[:MOST_ROWS]:
        yield row


def _known_keys(row: Mapping[str, str]) -> set[str]:
    """Return the keys of a variable's chosen distribution; the row may still have fields of the previous one."""
    return {"distribution", "target", *PARAMETERS.get(row.get("distribution", DEFAULT), {})}


def _typed(key: str, text: str) -> str | int | float:
    """Return a typed text as a number if the key is numeric and the text is a number, otherwise as text."""
    text = text.strip()
    if key in _TEXTS or not text:
        return text
    try:
        return int(text) if key in _WHOLE else float(text)
    except ValueError:
        return text


@dataclass(frozen=True)
class Draft:
    """A campaign that a user is writing."""

    text: str
    form: Tables | None = None  # as it was sent; None if there is none yet
    form_was: str = ""  # digest of the form when the page was last rendered
    text_was: str = ""  # digest of the text at that time
    files: dict[str, str] = field(default_factory=dict)  # texts of the files that the campaign names
    owner: str = ""
    tags: str = ""

    @property
    def form_changed(self) -> bool:
        """Whether the user has changed the form since the page was rendered."""
        return self.form is not None and digest(self.form) != self.form_was

    @property
    def text_changed(self) -> bool:
        """Whether the user has changed the text since the page was rendered."""
        return digest(self.text) != self.text_was

    def request(self) -> CampaignRequest:
        """Return the campaign to be checked or submitted."""
        files = {name: text.encode() for name, text in self.files.items()}
        tags = self.tags.replace(",", " ").split()
        if len(tags) > MOST_TAGS:
            raise Refusal(422, f"tags: there are {len(tags)}; allowed: up to {MOST_TAGS}; remove some")
        return CampaignRequest(text=self.text, files=files, owner=self.owner or None, tags=tags)


@router.get("/campaigns/new")
async def new_campaign_page(
    request: Request,
    service: TheService,
    who: Engineer,
    start: Annotated[str, Query(alias="from", pattern=CAMPAIGN_ID + "|^$")] = "",
    mechanism: Annotated[str, Query(max_length=64)] = FIRST_MECHANISM,
    set: WhatIfSettings = [],  # noqa: B006  # FastAPI copies it
    samples: Annotated[int | None, Query(ge=1, lt=2**53)] = None,
) -> Response:
    """Show the form of a new campaign, which may begin as a copy of another one with some distributions changed."""
    draft = Draft(first_text(mechanism), owner=who.name)
    if start:
        if not await run_in_threadpool(service.store.files.exists, f"{start}/{PLAN}"):
            raise Refusal(404, f"no campaign {start} in the store")
        url = service.store.files.full_url
        begun = await service.pool.data(who.name, started_from, url, start, tuple(set), samples)
        draft = replace(draft, text=begun["text"], files=begun["files"])
    found = await service.pool.data(who.name, composed, source_of_request(service, draft.request()))
    if not start:
        found |= {"faults": [], "detail": ""}  # the user has not written anything yet
    return await _shown(request, service, draft, found)


@router.post("/campaigns/new")
async def new_campaign_form(request: Request, service: TheService, who: Engineer) -> Response:
    """Derive the form and the text from each other, check them, or submit the campaign."""
    draft, action = await _sent(request)
    if action not in ACTIONS:
        raise Refusal(422, f"action {action!r:.20}: allowed: {', '.join(ACTIONS)}")
    if draft.form_changed and draft.text_changed and action not in ("write", "read"):
        return await _looked_at(request, service, who, draft, Refusal(409, BOTH_CHANGED))
    written = draft.form if action == "write" or (draft.form_changed and action != "read") else None
    source = source_of_request(service, draft.request())
    found = await service.pool.data(who.name, composed, source, written, action == "try")
    draft = replace(draft, text=found["text"])
    if action != "submit" or found["faults"] or found["detail"]:
        return await _shown(request, service, draft, found, 422 if action == "submit" else 200)
    try:
        made = await submit(service, who, draft.request())
    except (CampaignError, Refusal) as error:
        return await _looked_at(request, service, who, draft, refusal_of(error))
    return RedirectResponse(f"/campaigns/{quote(made.campaign)}", 303)


async def _sent(request: Request) -> tuple[Draft, str]:
    """Return the draft that a browser sent, and the action of the pressed button."""
    form = await request.form()
    try:
        sent = {key: value for key, value in form.multi_items() if isinstance(value, str)}
        files = dict(zip(form.getlist("file-name"), form.getlist("file-text"), strict=False))
        kept = {str(name): unix_lines(str(text)) for name, text in files.items() if name and str(text).strip()}
        for upload in form.getlist("upload"):
            if isinstance(upload, UploadFile) and upload.filename:
                kept[upload.filename] = await _text_of(upload)
    finally:
        await form.close()
    if len(kept) > MOST_FILES:
        raise Refusal(422, f"{len(kept)} files: allowed: up to {MOST_FILES}")
    draft = Draft(
        unix_lines(sent.get("text", ""))[:LONGEST_TEXT],
        tables_of(sent),
        sent.get("form-was", ""),
        sent.get("text-was", ""),
        kept,
        sent.get("owner", "")[:200],
        sent.get("tags", "")[:2000],
    )
    return draft, sent.get("action", "check")


async def _text_of(upload: UploadFile) -> str:
    """Return the text of an uploaded file; files that are not text must be sent with the API."""
    content = await upload.read(LONGEST_TEXT + 1)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Refusal(422, f"{upload.filename:.100}: is not text; send it with the API instead") from error
    if len(content) > LONGEST_TEXT:
        raise Refusal(422, f"{upload.filename:.100}: has more than {LONGEST_TEXT} bytes; send it with the API instead")
    return unix_lines(text)


async def _looked_at(
    request: Request, service: Service, who: Principal, draft: Draft, refusal: Refusal | None
) -> Response:
    """Return the page with the draft as it was sent, and the reason why nothing was done."""
    assert refusal is not None
    found = await service.pool.data(who.name, composed, source_of_request(service, draft.request()))
    found |= {"faults": refusal.faults, "detail": refusal.detail, "checked": None, "sent": True}
    answer = await _shown(request, service, draft, found, refusal.status)
    answer.headers.update(refusal.headers)
    return answer


async def _shown(
    request: Request, service: Service, draft: Draft, found: dict[str, Any], status: int = 200
) -> Response:
    """Return the page with form, text, faults and cost."""
    is_as_sent = "sent" in found
    tables: Tables = (draft.form if is_as_sent or found["form"] is None else found["form"]) or {}
    form = CampaignForm(tables, found["faults"], found)
    refusal = Refusal(status, found["detail"], found["faults"]) if found["detail"] else None
    saved = await run_in_threadpool(saved_mechanisms, service.store)
    values: dict[str, Any] = {"draft": draft, "form": form, "checked": found["checked"]}
    values["lines"] = marked_lines(draft.text, found["faults"])
    # of a draft that is shown as it was sent, form and text count as changed until one is derived from the other
    values["form_was"] = draft.form_was if is_as_sent else digest(_as_sent_again(form))
    values["text_was"] = draft.text_was if is_as_sent else digest(draft.text)
    values["mechanisms"] = [*library_names(), *saved, *draft.files]
    chosen = {"samplers": list(SAMPLERS), "distributions": list(DISTRIBUTIONS), "statistics": STATISTICS}
    numbers = " ".join(str(line.number) for line in values["lines"] if line.faults)
    return page(request, "new_campaign", status, refusal=refusal, fault_lines=numbers, **chosen, **values)


def _as_sent_again(form: CampaignForm) -> Tables:
    """Return the tables that `tables_of` returns if the form is sent back unchanged."""
    fields = [*form.top.values(), *form.stop.values()]
    for row in form.variables:
        fields += [row["name"], row["distribution"], row["target"], *row["parameters"]]
    for row in form.responses:
        fields += [row["name"], *row["limits"]]
    return tables_of({each.name: each.value for each in fields})
