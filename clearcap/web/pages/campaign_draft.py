"""Drafts of campaigns as jobs: form and text made from each other, their check, cost, and what they began with."""

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

from pydantic import TypeAdapter, ValidationError

from campaign.errors import CampaignError, SpecError
from campaign.inputs.distributions import DISTRIBUTIONS, Distribution, Variable
from campaign.plan import dump_spec
from campaign.spec import campaign_file
from campaign.spec.campaign_file import campaign_text
from campaign.spec.named_files import GivenFiles, campaign_names
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from campaign.store.mechanism_library import read_mechanism
from clearcap.questions.plan_differences import table_differences
from clearcap.questions.submissions import CampaignSource, check_campaign_text
from clearcap.questions.whatif import changed_variables
from clearcap.web.http.responses import faults_of
from engine import EngineError
from engine.mechanism import library_names
from engine.mechanism.keys.key_paths import PREFIX
from engine.mechanism.keys.values import settable_numbers
from engine.platform.toml_file import UnfitToml, parse_toml, text_bytes

Tables = dict[str, Any]
DEFAULT = "truncated_normal"
TOP_KEYS = ("name", "title", "mechanism", "bench", "preset", "samples", "seed", "sampler")
MOST_KEYS = 2000  # largest number of keys that a field proposes
SHOWN_KEYS = 30  # keys that the picker shows at once
ALTERNATIVES: tuple[tuple[str, ...], ...] = (  # parameters by one set of which a distribution is given, without others
    *(("mean", "std"), ("nominal", "tolerance", "cpk"), ("nominal", "inertia")),
    *(("alpha", "beta"), ("shape", "scale"), ("log_mean", "log_std")),
)
_EXPONENTIAL: tuple[tuple[str, ...], ...] = (("mean",), ("std",), ("scale",))
RARE = {"shift", "sigma_shift", "inflation"}  # parameters that few distributions are given
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
USUAL_LIMITS, DRAWN_LIMITS = ("lsl", "usl", "target"), ("nominal", "tolerance", "target")


def ways_of(kind: str) -> list[tuple[str, ...]]:
    """Return the sets of parameters by one of which a distribution is given; empty if there is no choice."""
    keys = PARAMETERS.get(kind, {}).keys()
    ways = _EXPONENTIAL if kind == "exponential" else ALTERNATIVES
    found = [way for way in ways if keys >= set(way)]
    return found if len(found) > 1 else []


def excluded(kind: str, way: Collection[str]) -> set[str]:
    """Return the parameters that do not go with a set of `ways_of`; none with another set."""
    ways = ways_of(kind)
    if tuple(way) not in ways:
        return set()
    return {key for each in ways for key in each} - {*way} | (set() if "nominal" in way else RARE)


def way_of(kind: str, given: Collection[str]) -> tuple[str, ...]:
    """Return the set of parameters that the most of the given ones belong to; empty if there is no choice."""
    return max(ways_of(kind), key=lambda way: len(set(way) & set(given)), default=())


_STOP = campaign_file.Stop.model_json_schema()
STOP_NUMBERS, STATISTICS = _numbers(_STOP), [str(each) for each in _STOP["properties"]["statistic"]["enum"]]


@dataclass(frozen=True)
class Wanted:
    """What a page wants of a draft, beside its check."""

    tries_runs: bool = False  # estimate the cost from some runs
    add: str = ""  # key of the mechanism that becomes a further variable
    search: str = ""  # words of the keys that the picker shows
    origin: str = ""  # what the draft began with: `campaign:ID` or `shipped:NAME`


def composed(source: CampaignSource, form: Tables | None = None, wanted: Wanted = Wanted()) -> Tables:
    """Return the text and the form of a campaign, one derived from the other, and their faults.

    A `form` overrides the text. ``form`` is None for no TOML, ``mechanism`` if it is faulty, ``checked`` if the check
    failed, ``differs`` without an origin; ``faults`` and ``detail`` are empty if the check passed.
    """
    store = open_store(source.store, QUICK)
    try:
        tables = parse_toml(text_bytes(source.text))
    except UnfitToml as error:
        fault: Tables = {"keys": [], "text": str(error), "value": None, "line": error.line, "file": None}
        nothing: Tables = {"form": None, "mechanism": None, "densities": {}, "checked": None, "differs": None}
        return {"text": source.text, **nothing, "faults": [fault], "detail": str(error)}
    if form is not None:
        tables = merged(tables, form)
    mechanism = _mechanism(store, source, tables, wanted.search)
    if wanted.add and mechanism:
        tables = with_variable(tables, mechanism, wanted.add)
    if form is not None or wanted.add:
        source = replace(source, text=campaign_text(tables))
    found: Tables = {"text": source.text, "form": form_tables(tables), "checked": None, "faults": [], "detail": ""}
    try:
        found["checked"] = check_campaign_text(source, wanted.tries_runs)
    except (CampaignError, EngineError) as error:
        found |= {"faults": faults_of(error), "detail": str(error)}
    variables = tables.get("variables")
    shown = variables if isinstance(variables, dict) else {}
    densities = {name: density for name, table in shown.items() if (density := _density(table))}
    differs = _differences(store, source, tables, wanted.origin)
    return {**found, "mechanism": mechanism, "densities": densities, "differs": differs}


def with_variable(tables: Mapping[str, Any], mechanism: Mapping[str, Any], key: str) -> Tables:
    """Return a campaign's tables with a further variable, which sets a key of the mechanism around its value.

    A parameter keeps its name, unless a response or another variable has it; of any other key it is the last two words.
    """
    value = next((each["value"] for each in mechanism["keys"] if each["key"] == key), None)
    given = tables.get("variables")
    before = given if isinstance(given, dict) else {}
    if value is None or key in before:
        return dict(tables)
    stem, own_name = "_".join(re.findall("[A-Za-z0-9_-]+", ".".join(key.split(".")[-2:]))), key.rpartition(".")[2]
    taken = before.keys() | mechanism["responses"].keys()
    name = own_name if key.startswith(PREFIX) and own_name not in taken else stem
    number = 2
    while name in taken:
        name, number = f"{stem}_{number}", number + 1
    own = {} if "." not in key else {"target": key}
    new = {key if "." not in key else name: {"distribution": DEFAULT, **own, "mean": value}}
    return {**tables, "variables": {**before, **new}}


def _differences(store: Store, source: CampaignSource, tables: Tables, origin: str) -> list[Tables] | None:
    """Return what differs from what a draft began with; None if that is nothing, or is gone."""
    kind, _, name = origin.partition(":")
    try:
        if kind == "shipped" and name in campaign_names():
            begun: Tables = {"text": shipped_campaign(name), "files": {}}
        elif kind == "campaign":
            begun = started_from(store.files.full_url, name)
        else:
            return None
    except CampaignError:
        return None
    own = {name: each for name, each in source.files.items() if isinstance(each, bytes)}
    files = {name: None if own.get(name) == text.encode() else "changed" for name, text in begun["files"].items()}
    before = parse_toml(text_bytes(begun["text"]))
    found = table_differences({**before, "files": dict.fromkeys(files)}, {**tables, "files": files})
    return [{"key": each.key, "was": each.here, "now": each.there, "changes_rows": each.changes_rows} for each in found]


def shipped_campaign(name: str) -> str:
    """Return the file of a shipped campaign."""
    return resources.files("campaign").joinpath("library", f"{name}.toml").read_text("utf-8")


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


def _mechanism(store: Store, source: CampaignSource, tables: Tables, search: str) -> Tables | None:
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
    numbers = sorted(
        (each for each in settable_numbers(mechanism) if each.varies),
        key=lambda each: (not each.short, not each.key.startswith(PREFIX)),  # what its author means to vary
    )
    keys = [
        {"key": n.short or n.key, "value": n.value, "unit": "" if n.unit == "1" else n.unit, "about": n.description}
        for n in numbers
    ]
    words = search.casefold().split()
    picked = [each for each in keys if all(word in f"{each['key']} {each['about']}".casefold() for word in words)]
    units = mechanism.response_units()
    return {
        "responses": {key: {"title": r.title, "unit": units[key]} for key, r in mechanism.responses.items()},
        "keys": keys[:MOST_KEYS],
        "picked": picked[:SHOWN_KEYS],
        "matching": len(picked),
        "benches": {key: bench.title for key, bench in benches.items()},
        "presets": {key: preset.title for key, preset in presets.items()},
    }
