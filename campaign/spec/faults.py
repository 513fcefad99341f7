"""Messages about faults of a campaign file: the key, its value, what is allowed, and what to do."""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError

from engine.errors import Fault
from engine.mechanism.faults import MOST_FAULTS, did_you_mean, locate

_LONGEST_VALUE = 60  # characters of a value in a line


@dataclass(frozen=True)
class SpecFault(Fault):
    """One fault of a campaign file; keys and values are shown as TOML writes them."""

    @property
    def key(self) -> str:
        """Dotted path of the key, with parts quoted where TOML requires it."""
        return ".".join(k if re.fullmatch(r"[A-Za-z0-9_-]+", k) else json.dumps(k) for k in self.keys)

    @property
    def shown(self) -> str:
        """The value as text; empty for tables and lists, and if there is no value."""
        if self.value is None or isinstance(self.value, dict | list):
            return ""
        text = json.dumps(self.value, ensure_ascii=False, default=str)
        return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."


def structure_faults(error: ValidationError, root: type[BaseModel]) -> list[SpecFault]:
    """Return the faults that pydantic found in a ``root``, each once, at most `MOST_FAULTS` of them."""
    found = (_fault(details, root) for details in error.errors(include_url=False)[: MOST_FAULTS + 1])
    return list({str(fault): fault for fault in found}.values())[:MOST_FAULTS]


def fault(keys: Iterable[str], value: Any, text: str, within: tuple[Fault, ...] = ()) -> SpecFault:
    """Return the fault of a key; ``within`` are the faults of the file that its value names."""
    return SpecFault(tuple(keys), text, value, within=within)


def _fault(error: Mapping[str, Any], root: type[BaseModel]) -> SpecFault:
    refused = error.get("ctx", {}) if error["type"] == "refused" else {}
    below = refused.get("key")  # a table refuses one of its keys
    at = locate(root, (*error["loc"], *below.split(".")) if below else error["loc"])
    keys = list(at.path)
    if keys[:1] == ["grid"] and len(keys) > 1:  # pydantic reports one error for each way to write levels
        text = "must be a number of levels, 2 to a million, or a list of levels, finite numbers; correct it"
        return fault(keys[:2], None, text)
    text = _text(error, keys, at.known_keys)
    if not keys:  # of the campaign as a whole
        return _with_its_key(text, root)
    return fault(keys, refused["value"] if below else error["input"], text)


def _with_its_key(text: str, root: type[BaseModel]) -> SpecFault:
    """Return the fault of a whole file, with the key and value if the text has the form ``key = value: ...``."""
    begins = re.fullmatch(r"([A-Za-z_][\w.-]*)(?: = ([^:]+))?: (.*)", text, re.DOTALL)
    if begins and begins[1].split(".")[0] in root.model_fields:
        try:
            value = None if begins[2] is None else json.loads(begins[2])
        except ValueError:
            value = None
        keyed = fault(begins[1].split("."), value, begins[3])
        # only if the message stays the same: a value may be written in another way than it is shown
        if str(keyed) == str(fault((), None, text)):
            return keyed
    return fault((), None, text)


def _text(error: Mapping[str, Any], keys: list[str], known: list[str]) -> str:
    """Return the fault, what is allowed and the remedy; ``known`` are the keys that the table may have."""
    match error["type"]:
        case "missing":
            return "missing; add it"
        case "extra_forbidden":
            return f"unknown key; allowed: {', '.join(known)}{did_you_mean(keys[-1], known)}"
        case "union_tag_invalid":
            from campaign.inputs.distributions import DISTRIBUTIONS  # loads scipy, which other messages do not need

            tag = error["ctx"]["tag"]
            allowed = ", ".join(DISTRIBUTIONS)
            return f'unknown distribution "{tag}"; allowed: {allowed}{did_you_mean(tag, DISTRIBUTIONS)}'
        case "value_error":
            return str(error["ctx"]["error"])
        case "string_pattern_mismatch":
            return "allowed: up to 60 letters, digits, - and _, the first a letter or digit; rename the campaign"
        case "too_short":
            what = "variable; add at least one table [variables.NAME]" if keys == ["variables"] else "entry; add one"
            return f"no {what}"
        case "model_type" | "model_attributes_type" | "dict_type":
            return "must be a table of keys; write {key = value, ...}"
        case "tuple_type":
            row = ', each a list [variable, variable, rank correlation], [["J1", "J2", 0.6]]'
            return f"must be a list{row if keys[0] == 'correlations' else ''}"
        case "float_type" | "int_type":
            quoted = ", written without quotes" if isinstance(error["input"], str) else ""
            return f"must be {'a whole' if error['type'] == 'int_type' else 'a'} number{quoted}"
        case "greater_than" | "greater_than_equal" | "less_than" | "less_than_equal":
            remedy = "increase it" if error["type"].startswith("greater") else "reduce it"
            return f"{_must(error)}; {remedy}"
    return _must(error)


def _must(error: Mapping[str, Any]) -> str:
    """Return pydantic's message reworded as a requirement."""
    text = str(error["msg"]).replace("Input should be", "must be").replace("String should", "must")
    return text.replace("greater than or equal to", "at least").replace("less than or equal to", "at most")
