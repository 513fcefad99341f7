"""The fields of a campaign's form: conversion from the sent form to tables, and from tables to the fields of a page."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

from campaign.web.jobs.campaign_form import LIMITS, PARAMETERS, STOP_NUMBERS, TOP_KEYS, Tables
from campaign.web.pages.marked_text import said

DEFAULT = "truncated_normal"
BLANK_ROWS = 2  # rows for further variables
MOST_ROWS = 1000
NO_MECHANISM: Tables = {"responses": {}, "keys": [], "benches": {}, "presets": {}}
_WHOLE = ("samples", "seed", "min_samples", "max_samples")
_TEXTS = ("name", "title", "mechanism", "bench", "preset", "sampler", "distribution", "target", "response", "statistic")


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
    """The fields of a campaign's form, with the faults of each.

    The arguments are results of `tables_of`, `campaign.web.http.problems.faults_of` and
    `campaign.web.jobs.campaign_form.composed`.
    """

    def __init__(self, tables: Tables, faults: Sequence[Mapping[str, Any]], found: Mapping[str, Any]) -> None:
        self._faults = [(tuple(each["keys"]), said(each)) for each in faults if not each.get("file")]
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
    for field, text in sent.items():
        place, _, key = field.partition(".")
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
