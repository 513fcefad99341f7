"""Recognise a file or folder given by mistake for another kind, and name the command that takes it."""

import os
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from engine.platform.regular_file import UnfitFile, read_beginning

# Top-level keys that only one of the two formats has.
MECHANISM_KEYS = frozenset(
    {
        *("units", "bodies", "joints", "materials", "contacts", "springs", "dampers", "forces", "torques", "motions"),
        *("gravity", "parameters", "validity", "benches", "presets"),
    }
)
CAMPAIGN_KEYS = frozenset(
    {
        *("mechanism", "samples", "seed", "sampler", "variables", "correlations", "grid", "table", "importance"),
        *("stop", "failures", "execution", "header"),
    }
)
_BEGINNING = 4096  # bytes, enough to recognise the kind of a file


def other_kind(tables: Mapping[str, Any], path: str | Path, wanted: str) -> str | None:
    """Return what this TOML file is, and which command takes it; None if it may be the mechanism or campaign wanted."""
    of_mechanism, of_campaign = len(tables.keys() & MECHANISM_KEYS), len(tables.keys() & CAMPAIGN_KEYS)
    name = shlex.quote(str(path))
    variables = tables.get("variables")
    costs = variables.values() if isinstance(variables, Mapping) and tables.keys() <= {"target", "variables"} else ()
    if any(isinstance(cost, Mapping) and cost.keys() & {"cost", "processes"} for cost in costs):
        return "is a cost file; clearcap advise takes it, after --cost"
    if wanted == "campaign" and of_mechanism > of_campaign:
        remedy = f"one run of it: clearcap simulate {name}; to vary it, name it in a campaign file as its mechanism"
        return f"is a mechanism file, not a campaign; {remedy}"
    if wanted == "mechanism" and of_campaign > of_mechanism:
        return f"is a campaign file, not a mechanism; compute it with: clearcap run {name}"
    return None


def unreadable_kind(path: str | Path, wanted: str) -> str | None:
    """Return what a folder or a non-TOML file is and which command takes it; None if that is not known."""
    if os.path.isdir(path):
        kind = _folder_kind(Path(path))
        return kind and f"{kind}; name a {wanted} file"
    try:
        beginning = read_beginning(path, _BEGINNING)
    except (OSError, UnfitFile):
        return None
    return content_kind(beginning, wanted)


def content_kind(content: bytes, wanted: str) -> str | None:
    """Return what kind of non-TOML file some content, or its beginning, is and which command takes it, if known."""
    beginning = content[:_BEGINNING]
    for pattern, kind in _CONTENTS.items():
        if re.match(pattern, beginning, re.DOTALL):
            return f"{kind}; name a {wanted} file"
    return None


def _folder_kind(folder: Path) -> str | None:
    """Return the description of a campaign's folder or of a store; None for any other folder."""
    name, parent = shlex.quote(folder.resolve().name), shlex.quote(str(folder.parent))
    if (folder / "plan.json").exists():
        return f"is the folder of a campaign in a store; continue that with: clearcap resume {name} --store {parent}"
    try:
        holds_plans = any((entry / "plan.json").exists() for entry in sorted(folder.iterdir())[:1000])
    except OSError:
        return None
    if holds_plans:
        return f"is a store of campaigns; list them with: clearcap list --store {shlex.quote(str(folder))}"
    return None


_CONTENTS = {
    rb"PAR1": "is a Parquet file, such as the rows of a campaign; clearcap report takes the id of that campaign",
    rb"\x89HDF\r\n": "is an HDF5 file, such as the motion of a run; read it with clearcap.read_trajectory in Python",
    rb'\s*\{.{0,200}"campaign":.{0,1000}"engine_build":': "is the plan of a campaign in a store; clearcap resume takes"
    " the id of that campaign",
    rb'\s*\{.{0,200}"title":.{0,2000}"campaign":': "is the data of a report; clearcap report takes the id of its"
    " campaign",
    rb'\s*[\[{]\s*["\]}{]': "is a JSON document",
    rb"%PDF": "is a PDF document",
    rb"PK\x03\x04": "is a workbook or another ZIP archive",
    rb"\s*<!doctype html|\s*<html": "is a web page, such as a report",
}
