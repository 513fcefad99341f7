"""Conversion between the form and the text of a campaign, with the densities and faults that a page shows.

The form has the keys that most campaigns need. All other keys, such as correlations, stay in the text unchanged.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from pydantic import TypeAdapter, ValidationError

from campaign.errors import CampaignError, SpecError
from campaign.inputs.distributions import DISTRIBUTIONS, Distribution, Variable
from campaign.plan import dump_spec
from campaign.spec.campaign_file import Response, Stop, campaign_text
from campaign.spec.named_files import GivenFiles
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from campaign.store.mechanism_library import read_mechanism
from clearcap.questions.submissions import CampaignSource, check_campaign_text
from clearcap.questions.whatif import changed_variables
from clearcap.web.http.problems import faults_of
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
LIMITS = _numbers(Response.model_json_schema())
STOP_NUMBERS = _numbers(Stop.model_json_schema())
STATISTICS = [str(each) for each in Stop.model_json_schema()["properties"]["statistic"]["enum"]]


def composed(source: CampaignSource, form: Tables | None = None, tries_runs: bool = False) -> Tables:
    """Return the text and the form of a campaign, one derived from the other, and their faults.

    A `form`, as `form_tables` returns it, overrides the text; `tries_runs` estimates the cost from some runs. Keys:
    ``text``; ``form`` (None if the text is not valid TOML); ``mechanism`` (None if missing or faulty); ``densities`` by
    variable; ``checked``, the result of the check (None if it failed); ``faults`` and ``detail``, empty if it passed.
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


def started_from(store: str, campaign_id: str, settings: Sequence[str] = (), samples: int | None = None) -> Tables:
    """Return ``text`` and ``files`` (texts by name) of a campaign in the store, as the start of a new campaign."""
    import tomli_w

    opened = open_store(store, QUICK)
    plan = opened.plan(campaign_id)
    changed = changed_variables(plan.spec, settings).variables if settings else {}
    update = {"variables": {**plan.spec.variables, **changed}, "samples": samples or plan.spec.samples}
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
    """Return a table with the values of the form, and the keys of the old table that the form does not own.

    ``owned`` are the keys that the form owns; None for a variable, where they depend on its distribution.
    """
    before = old if isinstance(old, dict) else {}
    if owned is None:
        has = before.get("distribution", "truncated_normal")
        same = new.get("distribution", "truncated_normal") == has
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
