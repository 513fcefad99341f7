"""The page for a new campaign: a form beside the text of its file, each derived from the other by a job.

The form has the keys that most campaigns need. All other keys, such as correlations, stay in the text unchanged.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError
from campaign.inputs.distributions import DISTRIBUTIONS
from campaign.inputs.sampling import SAMPLERS
from campaign.spec.named_files import MOST_FILES, campaign_names
from campaign.store.labels import MOST_TAGS
from campaign.store.layout import PLAN
from campaign.store.mechanism_library import saved_mechanisms
from clearcap.web.access import Principal
from clearcap.web.http.authentication import CAMPAIGN_ID, Engineer, TheService
from clearcap.web.http.responses import Refusal, refusal_of
from clearcap.web.jobs.queries import MOST_SETTINGS
from clearcap.web.operations import submissions
from clearcap.web.operations.drawings import campaign_of, the_draft
from clearcap.web.operations.mechanisms import LONGEST_TEXT
from clearcap.web.operations.samples import Setting
from clearcap.web.pages.campaign_draft import (
    DEFAULT,
    DRAWN_LIMITS,
    LIMITS,
    PARAMETERS,
    RARE,
    SHOWN_KEYS,
    STATISTICS,
    STOP_NUMBERS,
    TOP_KEYS,
    USUAL_LIMITS,
    Tables,
    Wanted,
    composed,
    excluded,
    first_text,
    shipped_campaign,
    started_from,
    way_of,
    ways_of,
)
from clearcap.web.pages.rendering import fault_line, marked_lines, page, unix_lines, uploaded_text
from clearcap.web.web_service import Service
from engine.mechanism import library_names

BLANK_ROWS = 1  # rows for further variables
MOST_OPEN = 4  # variables or responses that are all unfolded; of more only those that lack something
MOST_ROWS = 1000
NO_MECHANISM: Tables = {"responses": {}, "keys": [], "picked": [], "matching": 0, "benches": {}, "presets": {}}
_WHOLE = ("samples", "seed", "min_samples", "max_samples")
_TEXTS = ("name", "title", "mechanism", "bench", "preset", "sampler", "distribution", "target", "response", "statistic")
router = APIRouter(include_in_schema=False)
FIRST_MECHANISM = "c60"
ACTIONS = ("write", "read", "check", "try", "search", "add", "submit")
ORIGIN = re.compile(r"(campaign|shipped):[A-Za-z0-9][A-Za-z0-9_-]{0,99}")
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
    """Return the campaign's tables from a form; row ``i`` has ``v{i}.KEY`` or ``r{i}.KEY``, the stop ``stop.KEY``."""
    tables: Tables = {key: value for key in TOP_KEYS if (value := _typed(key, sent.get(key, ""))) != ""}
    for letter, table in (("v", "variables"), ("r", "responses")):
        tables[table] = {}
        for row in _rows(sent, letter):
            name = row.pop("name", "").strip()
            if name:
                # a variable's row may still have fields of the distribution before, or of another way to give it
                kind, way = row.get("distribution", DEFAULT), tuple(row.get("given", "").split())
                for key, former in (("nominal", "mean"), ("mean", "nominal")):
                    if key in way and former not in way and not row.get(key, "").strip():
                        row[key] = row.get(former, "")
                keys = {"distribution", "target", *PARAMETERS.get(kind, {})} - excluded(kind, way)
                known = keys if letter == "v" else {*LIMITS}
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

    def __init__(
        self,
        tables: Tables,
        faults: Sequence[Mapping[str, Any]],
        found: Mapping[str, Any],
        ways: Mapping[str, tuple[str, ...]],
    ) -> None:
        self._faults = [(tuple(each["keys"]), fault_line(each)) for each in faults if not each.get("file")]
        self._tables, self._known, self._ways = tables, found.get("mechanism") or NO_MECHANISM, ways
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
        given = self._tables.get("variables", {})
        is_few = len(given) <= MOST_OPEN
        for i, (name, table) in enumerate([*given.items(), *blank]):
            kind = str(table.get("distribution", DEFAULT))
            keys = ("variables", name)
            fields = {
                key: self._field(f"v{i}.{key}", (*keys, key), table.get(key), hint)
                for key, hint in PARAMETERS.get(kind, {}).items()
            }
            ways, way = ways_of(kind), self._ways.get(name, ())
            if way not in ways or excluded(kind, way) & table.keys():
                way = way_of(kind, table)
            # of another way only what is given, which is a fault then
            others = excluded(kind, way)
            parameters = [each for key, each in fields.items() if key not in {*others, *RARE} or each.value]
            named = {"distribution", "target", *PARAMETERS.get(kind, {})}
            rest = [text for at, text in self._faults if name and at[:2] == keys and (at[2:3] or ("",))[0] not in named]
            density = densities.get(name) if name else None
            yield {
                "is_open": is_few or (bool(name) and density is None) or self._has_faults(*keys),
                "name": FormField(f"v{i}.name", "name", name, tuple(rest)),
                "distribution": self._field(f"v{i}.distribution", (*keys, "distribution"), kind),
                "target": self._field(f"v{i}.target", (*keys, "target"), table.get("target")),
                "given": FormField(f"v{i}.given", "given", " ".join(way)),
                "ways": {" ".join(each): ", ".join(each) for each in ways},
                "parameters": parameters,
                "rare": [each for key, each in fields.items() if key in RARE - others and not each.value],
                "density": density,
            }

    def _responses(self) -> Iterator[dict[str, Any]]:
        """Yield the rows of the responses: those of the mechanism, then others that the file names."""
        given, known = self._tables.get("responses", {}), self._known["responses"]
        names = [*known, *(name for name in given if name not in known)]
        is_few = len(names) <= MOST_OPEN
        for i, name in enumerate(names):
            keys, table = ("responses", name), given.get(name, {})
            every = [self._field(f"r{i}.{key}", (*keys, key), table.get(key), hint) for key, hint in LIMITS.items()]
            usual = DRAWN_LIMITS if {"nominal", "tolerance"} & table.keys() else USUAL_LIMITS
            limits = [each for each in every if each.key in usual or each.value or each.faults]
            own = tuple(text for at, text in self._faults if at[:2] == keys and (at[2:3] or ("",))[0] not in LIMITS)
            about = known.get(name, {"title": "", "unit": ""})
            rare = [each for each in every if each not in limits]
            row = {"name": FormField(f"r{i}.name", "name", name, own), "limits": limits, "rare": rare, **about}
            yield row | {"is_open": is_few or self._has_faults(*keys)}

    def _has_faults(self, table: str, name: str) -> bool:
        """Return whether a row of a table has faults."""
        return any(at[:2] == (table, name) for at, _ in self._faults)

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
    origin: str = ""  # see `Wanted`
    search: str = ""
    ways: dict[str, tuple[str, ...]] = field(default_factory=dict)  # by variable, see `ways_of`

    @property
    def form_changed(self) -> bool:
        """Whether the user has changed the form since the page was rendered."""
        return self.form is not None and digest(self.form) != self.form_was

    @property
    def text_changed(self) -> bool:
        """Whether the user has changed the text since the page was rendered."""
        return digest(self.text) != self.text_was

    def request(self) -> submissions.CampaignRequest:
        """Return the campaign to be checked or submitted."""
        files = {name: text.encode() for name, text in self.files.items()}
        tags = self.tags.replace(",", " ").split()
        if len(tags) > MOST_TAGS:
            raise Refusal(422, f"tags: there are {len(tags)}; allowed: up to {MOST_TAGS}; remove some")
        return submissions.CampaignRequest(text=self.text, files=files, owner=self.owner or None, tags=tags)


class Beginning(BaseModel):
    """What a new campaign begins with: a mechanism, a draft from a drawing, or a campaign, perhaps with changes."""

    start: str = Field("", alias="from", pattern=CAMPAIGN_ID + "|^$")
    mechanism: str = Field(FIRST_MECHANISM, max_length=64)
    drawing: str = Field("", max_length=64)
    set: list[Setting] = Field([], max_length=MOST_SETTINGS)
    samples: int | None = Field(None, ge=1, lt=2**53)
    seed: int | None = Field(None, ge=0, lt=2**63)
    shipped: str = Field("", max_length=64)


@router.get("/campaigns/new")
async def new_campaign_page(
    request: Request, service: TheService, who: Engineer, asked: Annotated[Beginning, Query()]
) -> Response:
    """Show the form of a new campaign, which may begin as a copy of another one with some distributions changed."""
    text = campaign_of(await the_draft(service, asked.drawing)) if asked.drawing else ""
    if asked.shipped and asked.shipped not in campaign_names():
        raise Refusal(404, f"no shipped campaign {asked.shipped}; there are: {', '.join(campaign_names())}")
    text = shipped_campaign(asked.shipped) if asked.shipped else text
    origin = f"campaign:{asked.start}" if asked.start else f"shipped:{asked.shipped}" if asked.shipped else ""
    draft = Draft(text or first_text(asked.drawing or asked.mechanism), owner=who.name, origin=origin)
    if asked.start:
        if not await run_in_threadpool(service.store.files.exists, f"{asked.start}/{PLAN}"):
            raise Refusal(404, f"no campaign {asked.start} in the store")
        changes = tuple(asked.set), asked.samples, asked.seed
        url = service.store.files.full_url
        begun = await service.pool.data(who.name, started_from, url, asked.start, *changes)
        draft = replace(draft, text=begun["text"], files=begun["files"])
    source = submissions.source_of_request(service, draft.request())
    found = await service.pool.data(who.name, composed, source, None, Wanted(origin=origin))
    if not origin:
        found |= {"faults": [], "detail": ""}  # the user has not written anything yet
    return await _shown(request, service, draft, found)


@router.post("/campaigns/new")
async def new_campaign_form(request: Request, service: TheService, who: Engineer) -> Response:
    """Derive the form and the text from each other, check them, or submit the campaign."""
    draft, action, add = await _sent(request)
    if action not in ACTIONS:
        raise Refusal(422, f"action {action!r:.20}: allowed: {', '.join(ACTIONS)}")
    if draft.form_changed and draft.text_changed and action not in ("write", "read"):
        return await _looked_at(request, service, who, draft, Refusal(409, BOTH_CHANGED))
    written = draft.form if action == "write" or (draft.form_changed and action != "read") else None
    source = submissions.source_of_request(service, draft.request())
    wanted = Wanted(action == "try", add, draft.search, draft.origin)
    found = await service.pool.data(who.name, composed, source, written, wanted)
    draft = replace(draft, text=found["text"])
    if action != "submit" or found["faults"] or found["detail"]:
        return await _shown(request, service, draft, found, 422 if action == "submit" else 200)
    try:
        made = await submissions.submit(service, who, draft.request())
    except (CampaignError, Refusal) as error:
        return await _looked_at(request, service, who, draft, refusal_of(error))
    return RedirectResponse(f"/campaigns/{quote(made.campaign)}", 303)


async def _sent(request: Request) -> tuple[Draft, str, str]:
    """Return the draft that a browser sent, the action of the pressed button, and the key that it adds."""
    async with request.form() as form:
        sent = {key: value for key, value in form.multi_items() if isinstance(value, str)}
        files = dict(zip(form.getlist("file-name"), form.getlist("file-text"), strict=False))
        kept = {str(name): unix_lines(str(text)) for name, text in files.items() if name and str(text).strip()}
        for upload in form.getlist("upload"):
            if isinstance(upload, UploadFile) and upload.filename:
                kept[upload.filename] = await uploaded_text(upload, f"{upload.filename:.100}", "send it with the API")
    if len(kept) > MOST_FILES:
        raise Refusal(422, f"{len(kept)} files: allowed: up to {MOST_FILES}")
    was, text = (sent.get("form-was", ""), sent.get("text-was", "")), unix_lines(sent.get("text", ""))[:LONGEST_TEXT]
    draft = Draft(text, tables_of(sent), *was, kept, sent.get("owner", "")[:200], sent.get("tags", "")[:2000])
    origin = sent.get("origin", "")
    origin = origin if ORIGIN.fullmatch(origin) else ""
    add = sent.get("add", "")[:200]
    ways = {row.get("name", "").strip(): tuple(row.get("given", "").split()) for row in _rows(sent, "v")}
    draft = replace(draft, origin=origin, search=sent.get("search", "")[:200], ways=ways)
    return draft, "add" if add else sent.get("action", "check"), add


async def _looked_at(
    request: Request, service: Service, who: Principal, draft: Draft, refusal: Refusal | None
) -> Response:
    """Return the page with the draft as it was sent, and the reason why nothing was done."""
    assert refusal is not None
    source = submissions.source_of_request(service, draft.request())
    found = await service.pool.data(who.name, composed, source, None, Wanted(search=draft.search, origin=draft.origin))
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
    form = CampaignForm(tables, found["faults"], found, draft.ways)
    refusal = Refusal(status, found["detail"], found["faults"]) if found["detail"] else None
    saved = await run_in_threadpool(saved_mechanisms, service.store)
    values: dict[str, Any] = {"draft": draft, "form": form, "checked": found["checked"], "differs": found["differs"]}
    values |= {"shipped": campaign_names(), "shown_keys": SHOWN_KEYS}
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
        fields += [row["name"], row["distribution"], row["target"], row["given"], *row["parameters"], *row["rare"]]
    for row in form.responses:
        fields += [row["name"], *row["limits"], *row["rare"]]
    return tables_of({each.name: each.value for each in fields})
