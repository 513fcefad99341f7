"""The wording of faults of a campaign file: which key, which value, what is allowed, what to do."""

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from campaign.inputs.distributions import DISTRIBUTIONS
from engine.mechanism.faults import MOST_FAULTS, did_you_mean, locate, one_line


def structure_faults(error: ValidationError, root: type[BaseModel]) -> list[str]:
    """Return one line for each fault that pydantic sees, at most as many as are listed.

    Parameters
    ----------
    error : ValidationError
        What pydantic raised.
    root : type of BaseModel
        The model that was validated.
    """
    lines = dict.fromkeys(_line(details, root) for details in error.errors(include_url=False)[: MOST_FAULTS + 1])
    return list(lines)[:MOST_FAULTS]


def fault(keys: Iterable[str], value: Any, text: str) -> str:
    """Return ``table.key = value: text``; tables are named without their content."""
    shown = "" if value is None or isinstance(value, (dict, list)) else f" = {_shown(value)}"
    return one_line(f"{key_path(keys)}{shown}: {text}")


def key_path(keys: Iterable[str]) -> str:
    """Return a dotted TOML key, parts quoted where TOML needs it."""
    return ".".join(k if re.fullmatch(r"[A-Za-z0-9_-]+", k) else json.dumps(k) for k in keys)


def _line(error: Mapping[str, Any], root: type[BaseModel]) -> str:
    """Return one fault with its key and value."""
    refused = error.get("ctx", {}) if error["type"] == "refused" else {}
    below = refused.get("key")  # a table refuses one of its keys
    at = locate(root, (*error["loc"], *below.split(".")) if below else error["loc"])
    keys = list(at.path)
    if keys[:1] == ["grid"] and len(keys) > 1:  # pydantic has an error for each of the two ways to write levels
        text = "must be a number of levels, 2 to a million, or a list of levels, finite numbers; correct it"
        return fault(keys[:2], None, text)
    text = _text(error, keys, at.known_keys)
    value = refused["value"] if below else error["input"]
    return fault(keys, value, text) if keys else text  # without keys: of the campaign as a whole


def _text(error: Mapping[str, Any], keys: list[str], known: list[str]) -> str:
    """Return what is wrong, what is allowed and the remedy; ``known`` are the keys that the table may have."""
    match error["type"]:
        case "missing":
            return "missing; add it"
        case "extra_forbidden":
            return f"unknown key; allowed: {', '.join(known)}{did_you_mean(keys[-1], known)}"
        case "union_tag_invalid":
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
            return f"must be {'a whole' if error['type'] == 'int_type' else 'a'} number, written without quotes"
        case "greater_than" | "greater_than_equal" | "less_than" | "less_than_equal":
            remedy = "enlarge it" if error["type"].startswith("greater") else "reduce it"
            return f"{_must(error)}; {remedy}"
    return _must(error)


def _must(error: Mapping[str, Any]) -> str:
    """Return pydantic's own words as a demand."""
    return str(error["msg"]).replace("Input should be", "must be").replace("String should", "must")


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
