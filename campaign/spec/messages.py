"""Faults of a campaign file in words: which key, which value, what is allowed, what to do."""

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from campaign.inputs.distributions import DISTRIBUTIONS, Batch
from campaign.spec.campaign_file import CampaignSpec, Response, Rows
from campaign.spec.policy import Execution, Failures, Simulation, Stop
from engine.mechanism.faults import did_you_mean

_TABLES: dict[str, type[BaseModel]] = {
    "responses": Response,
    "simulation": Simulation,
    "failures": Failures,
    "execution": Execution,
    "stop": Stop,
    "table": Rows,
}


def structure_faults(error: ValidationError) -> list[str]:
    """Return one line for each fault pydantic found in a campaign."""
    return list(dict.fromkeys(_line(fault) for fault in error.errors(include_url=False)))


def fault(keys: Iterable[str], value: Any, text: str) -> str:
    """Return ``table.key = value: text``; tables are named without their content."""
    shown = "" if value is None or isinstance(value, (dict, list)) else f" = {_shown(value)}"
    return f"{key_path(keys)}{shown}: {text}"


def key_path(keys: Iterable[str]) -> str:
    """Return a dotted TOML key, parts quoted where TOML needs it."""
    return ".".join(k if re.fullmatch(r"[A-Za-z0-9_-]+", k) else json.dumps(k) for k in keys)


def _line(error: Mapping[str, Any]) -> str:
    keys = [str(part) for part in error["loc"]]
    if keys[:1] == ["grid"] and len(keys) > 1:  # pydantic says what is wrong with either way to write levels
        text = "must be a number of levels, at least 2, or a list of levels, finite numbers; correct it"
        return fault(keys[:2], None, text)
    if not keys:  # of the campaign as a whole
        return _text(error, keys, CampaignSpec)
    if keys[0] == "variables" and len(keys) > 2 and keys[2] in DISTRIBUTIONS:
        model: type[BaseModel] = DISTRIBUTIONS[keys.pop(2)]
        model = Batch if keys[2:3] == ["batch"] and len(keys) > 3 else model
    else:
        model = _TABLES.get(keys[0], CampaignSpec) if len(keys) > 1 else CampaignSpec
    return fault(keys, error["input"], _text(error, keys, model))


def _text(error: Mapping[str, Any], keys: list[str], model: type[BaseModel]) -> str:
    """Return what is wrong, what is allowed and the remedy."""
    names = list(model.model_fields)
    match error["type"]:
        case "missing":
            return "missing; add it"
        case "extra_forbidden":
            return f"unknown key; allowed: {', '.join(names)}{did_you_mean(keys[-1], names)}"
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
