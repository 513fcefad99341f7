"""The page for a new campaign: a form beside the text of its file, each derived from the other by a job.

The form has the keys that most campaigns need. All other keys, such as correlations, stay in the text unchanged.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, Field, TypeAdapter, ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError, SpecError
from campaign.inputs.distributions import DISTRIBUTIONS, Distribution, Variable
from campaign.inputs.sampling import SAMPLERS
from campaign.plan import dump_spec
from campaign.spec import campaign_file
from campaign.spec.campaign_file import campaign_text
from campaign.spec.named_files import MOST_FILES, GivenFiles
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from campaign.store.labels import MOST_TAGS
from campaign.store.layout import PLAN
from campaign.store.mechanism_library import read_mechanism, saved_mechanisms
from clearcap.questions.submissions import CampaignSource, check_campaign_text
from clearcap.questions.whatif import changed_variables
from clearcap.web.access import Principal
from clearcap.web.http.authentication import CAMPAIGN_ID, Engineer, TheService
from clearcap.web.http.responses import Refusal, faults_of, refusal_of
from clearcap.web.jobs.queries import MOST_SETTINGS
from clearcap.web.operations import submissions
from clearcap.web.operations.drawings import campaign_of, the_draft
from clearcap.web.operations.mechanisms import LONGEST_TEXT
from clearcap.web.operations.samples import Setting
from clearcap.web.pages.rendering import fault_line, marked_lines, page, unix_lines, uploaded_text
from clearcap.web.web_service import Service
from engine import EngineError
from engine.mechanism import library_names
from engine.mechanism.keys.values import settable_numbers
from engine.platform.toml_file import UnfitToml, parse_toml, text_bytes

Tables = dict[str, Any]
TOP_KEYS = ("name", "title", "mechanism", "bench", "preset", "samples", "seed", "sampler")
MOST_KEYS = 2000  # largest number of keys that a field proposes
WIDTH, HEIGHT, POINTS = 120.0, 32.0, 61  # size of the picture of a density, and number of its points
_VARIABLE: TypeAdapter[Distribution] = TypeAdapter(Variable)


def _numbers(schema: Mapping[str, Any]) -> dict[str, str]:
    """Return the numeric keys of a table, each with its description; the bounds come last."""
    found = {}
    for key, each in schema["properties"].items():
        kinds = {one.get("type") for one in (each, *each.get("anyOf", ()))}
        if kinds & {"number", "integer"} and "array" not in kinds:
            found[key] = str(each.get("description", ""))
    return dict(sorted(found.items(), key=lambda pair: pair[0] in ("lower", "upper")))


PARAMETERS = {name: _numbers(model.model_json_schema()) for name, model in DISTRIBUTIONS.items()}
LIMITS = _numbers(campaign_file.Response.model_json_schema())
_STOP = campaign_file.Stop.model_json_schema()
STOP_NUMBERS, STATISTICS = _numbers(_STOP), [str(each) for each in _STOP["properties"]["statistic"]["enum"]]


def composed(source: CampaignSource, form: Tables | None = None, tries_runs: bool = False) -> Tables:
    """Return the text and the form of a campaign, one derived from the other, and their faults.

    A `form` overrides the text; `tries_runs` estimates the cost from some runs. ``form`` is None for no TOML,
    ``mechanism`` if it is faulty, ``checked`` if the check failed; ``faults`` and ``detail`` are empty if it passed.
    """
    store = open_store(source.store, QUICK)
    try:
        tables = parse_toml(text_bytes(source.text))
    except UnfitToml as error:
        fault: Tables = {"keys": [], "text": str(error), "value": None, "line": error.line, "file": None}
        nothing: Tables = {"form": None, "mechanism": None, "densities": {}, "checked": None}
        return {"text": source.text, **nothing, "faults": [fault], "detail": str(error)}
    if form is not None:
        tables = merged(tables, form)
        source = replace(source, text=campaign_text(tables))
    found: Tables = {"text": source.text, "form": form_tables(tables), "checked": None, "faults": [], "detail": ""}
    try:
        found["checked"] = check_campaign_text(source, tries_runs)
    except (CampaignError, EngineError) as error:
        found |= {"faults": faults_of(error), "detail": str(error)}
    variables = tables.get("variables")
    shown = variables if isinstance(variables, dict) else {}
    densities = {name: density for name, table in shown.items() if (density := _density(table))}
    return {**found, "mechanism": _mechanism(store, source, tables), "densities": densities}


def form_tables(tables: Mapping[str, Any]) -> Tables:
    """Return the parts of a campaign's tables that the form shows, as plain data."""
    shown: Tables = {key: tables[key] for key in TOP_KEYS if key in tables}
    for key in ("variables", "responses"):
        given = tables.get(key)
        shown[key] = {}
        for name, table in given.items() if isinstance(given, dict) else ():
            shown[key][name] = _scalars(table)
    shown["stop"] = _scalars(tables.get("stop"))
    plain: Tables = json.loads(json.dumps(shown, default=str))
    return plain


def merged(tables: Mapping[str, Any], form: Tables) -> Tables:
    """Return a campaign's tables, overridden by the content of the form."""
    result: Tables = {"format": 1, **tables}
    for key in TOP_KEYS:
        _set(result, key, form.get(key))
    for key, owned in (("variables", None), ("responses", LIMITS)):
        old = tables.get(key)
        before = old if isinstance(old, dict) else {}
        result[key] = {name: _table(before.get(name), table, owned) for name, table in form.get(key, {}).items()}
    result["responses"] = {name: table for name, table in result["responses"].items() if table}
    stop = _table(tables.get("stop"), form.get("stop", {}), {**STOP_NUMBERS, "response": "", "statistic": ""})
    _set(result, "stop", stop if form.get("stop") else None)
    return {key: value for key, value in result.items() if value != {} or key == "variables"}


def started_from(
    store: str, campaign_id: str, settings: Sequence[str] = (), samples: int | None = None, seed: int | None = None
) -> Tables:
    """Return ``text`` and ``files`` (texts by name) of a campaign in the store, as the start of a new campaign."""
    import tomli_w

    opened = open_store(store, QUICK)
    plan = opened.plan(campaign_id)
    changed = changed_variables(plan.spec, settings).variables if settings else {}
    update = {"variables": {**plan.spec.variables, **changed}, "samples": samples or plan.spec.samples}
    update |= {} if seed is None else {"seed": seed}
    tables, name = dump_spec(plan.spec.model_copy(update=update)), plan.spec.mechanism
    if name in library_names() or read_mechanism(opened, name) is not None:
        return {"text": campaign_text(tables), "files": {}}
    # the plan contains the mechanism with bench and preset already applied
    tables = {key: value for key, value in tables.items() if key not in ("bench", "preset")}
    tables["mechanism"] = "mechanism.toml"
    document = json.loads(plan.mechanism.model_dump_json(by_alias=True, exclude_none=True))
    return {"text": campaign_text(tables), "files": {"mechanism.toml": tomli_w.dumps(document)}}


def first_text(mechanism: str, samples: int = 1000) -> str:
    """Return the text that a new campaign begins with."""
    name = "".join(c if c.isalnum() and c.isascii() else "-" for c in mechanism)[:50].strip("-") or "campaign"
    return campaign_text({"format": 1, "name": name, "mechanism": mechanism, "samples": samples, "variables": {}})


def _scalars(table: Any) -> Tables:
    """Return the strings and numbers of a table."""
    given = table if isinstance(table, dict) else {}
    return {key: value for key, value in given.items() if isinstance(value, str | int | float)}


def _set(table: Tables, key: str, value: Any) -> None:
    """Set a key, or remove it if the form has no value; an equal number keeps its type in the table."""
    if value is None or value == "":
        table.pop(key, None)
    elif table.get(key) != value or isinstance(table.get(key), bool):
        table[key] = value


def _table(old: Any, new: Tables, owned: Mapping[str, str] | None) -> Tables:
    """Return a table with the form's values and the old keys that the form does not own (None: of a distribution)."""
    before = old if isinstance(old, dict) else {}
    if owned is None:
        has = before.get("distribution", DEFAULT)
        same = new.get("distribution", DEFAULT) == has
        owned = {**PARAMETERS.get(str(has), {}), "distribution": "", "target": ""}
        before = before if same else {}
    result = {key: value for key, value in before.items() if key not in owned or key in new}
    for key, value in new.items():
        _set(result, key, value)
    return result


def _density(table: Any) -> Tables | None:
    """Return the curve of a density as points of a polyline, its ends, and its description; None if a key is wrong."""
    try:
        distribution = _VARIABLE.validate_python(table)
        points = distribution.density_points(POINTS)
        low, high = distribution.ends()
    except (ValidationError, SpecError, ValueError, ArithmeticError, OSError):
        return None
    top = max((y for _, y in points), default=0.0)
    if not points or not high > low or not 0.0 < top < float("inf"):
        return {"points": "", "low": low, "high": high, "text": distribution.text()}
    scaled = (((x - low) / (high - low) * WIDTH, HEIGHT - 2.0 - y / top * (HEIGHT - 4.0)) for x, y in points)
    drawn = [(0.0, HEIGHT - 2.0), *scaled, (WIDTH, HEIGHT - 2.0)]
    return {"points": " ".join(f"{x:.1f},{y:.1f}" for x, y in drawn), "low": low, "high": high,
            "text": distribution.text()}  # fmt: skip


def _mechanism(store: Store, source: CampaignSource, tables: Tables) -> Tables | None:
    """Return the data that the form needs of the campaign's mechanism; None if it is missing or has faults."""
    name = tables.get("mechanism")
    if not isinstance(name, str) or not name:
        return None
    try:
        mechanism = GivenFiles(source.contents(store)).mechanism(name)
        benches, presets = dict(mechanism.benches), dict(mechanism.presets)
        bench = tables.get("bench")
        mechanism = mechanism.on_bench(bench) if isinstance(bench, str) and bench else mechanism
    except (CampaignError, EngineError):
        return None
    keys = [each.short or each.key for each in settable_numbers(mechanism) if each.varies]
    units = mechanism.response_units()
    return {
        "responses": {key: {"title": r.title, "unit": units[key]} for key, r in mechanism.responses.items()},
        "keys": sorted(keys, key=lambda key: "." in key)[:MOST_KEYS],
        "benches": {key: bench.title for key, bench in benches.items()},
        "presets": {key: preset.title for key, preset in presets.items()},
    }


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
    """Return the campaign's tables from a form; row ``i`` has ``v{i}.KEY`` or ``r{i}.KEY``, the stop ``stop.KEY``."""
    tables: Tables = {key: value for key in TOP_KEYS if (value := _typed(key, sent.get(key, ""))) != ""}
    for letter, table in (("v", "variables"), ("r", "responses")):
        tables[table] = {}
        for row in _rows(sent, letter):
            name = row.pop("name", "").strip()
            if name:
                # a variable's row may still have fields of the distribution before
                keys = {"distribution", "target", *PARAMETERS.get(row.get("distribution", DEFAULT), {})}
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

    def request(self) -> submissions.CampaignRequest:
        """Return the campaign to be checked or submitted."""
        files = {name: text.encode() for name, text in self.files.items()}
        tags = self.tags.replace(",", " ").split()
        if len(tags) > MOST_TAGS:
            raise Refusal(422, f"tags: there are {len(tags)}; allowed: up to {MOST_TAGS}; remove some")
        return submissions.CampaignRequest(text=self.text, files=files, owner=self.owner or None, tags=tags)


class Beginning(BaseModel):
    """What a new campaign begins with: a mechanism, a draft from a drawing, or another campaign with changes."""

    start: str = Field("", alias="from", pattern=CAMPAIGN_ID + "|^$")
    mechanism: str = Field(FIRST_MECHANISM, max_length=64)
    drawing: str = Field("", max_length=64)
    set: list[Setting] = Field([], max_length=MOST_SETTINGS)
    samples: int | None = Field(None, ge=1, lt=2**53)
    seed: int | None = Field(None, ge=0, lt=2**63)


@router.get("/campaigns/new")
async def new_campaign_page(
    request: Request, service: TheService, who: Engineer, asked: Annotated[Beginning, Query()]
) -> Response:
    """Show the form of a new campaign, which may begin as a copy of another one with some distributions changed."""
    text = campaign_of(await the_draft(service, asked.drawing)) if asked.drawing else ""
    draft = Draft(text or first_text(asked.drawing or asked.mechanism), owner=who.name)
    if asked.start:
        if not await run_in_threadpool(service.store.files.exists, f"{asked.start}/{PLAN}"):
            raise Refusal(404, f"no campaign {asked.start} in the store")
        changes = tuple(asked.set), asked.samples, asked.seed
        url = service.store.files.full_url
        begun = await service.pool.data(who.name, started_from, url, asked.start, *changes)
        draft = replace(draft, text=begun["text"], files=begun["files"])
    found = await service.pool.data(who.name, composed, submissions.source_of_request(service, draft.request()))
    if not asked.start:
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
    source = submissions.source_of_request(service, draft.request())
    found = await service.pool.data(who.name, composed, source, written, action == "try")
    draft = replace(draft, text=found["text"])
    if action != "submit" or found["faults"] or found["detail"]:
        return await _shown(request, service, draft, found, 422 if action == "submit" else 200)
    try:
        made = await submissions.submit(service, who, draft.request())
    except (CampaignError, Refusal) as error:
        return await _looked_at(request, service, who, draft, refusal_of(error))
    return RedirectResponse(f"/campaigns/{quote(made.campaign)}", 303)


async def _sent(request: Request) -> tuple[Draft, str]:
    """Return the draft that a browser sent, and the action of the pressed button."""
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
    return draft, sent.get("action", "check")


async def _looked_at(
    request: Request, service: Service, who: Principal, draft: Draft, refusal: Refusal | None
) -> Response:
    """Return the page with the draft as it was sent, and the reason why nothing was done."""
    assert refusal is not None
    found = await service.pool.data(who.name, composed, submissions.source_of_request(service, draft.request()))
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
