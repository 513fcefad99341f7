"""What differs between the plans of campaigns, key by key, with what changes rows first."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from campaign.coordinator.submit import IRRELEVANT
from campaign.plan_header import parse_plan
from campaign.store import Store
from campaign.store.layout import PLAN

MOST = 200  # differences of two plans
LONGEST = 40  # characters of a value in words


@dataclass(frozen=True)
class PlanDifference:
    """One key in which two plans differ; None stands for a key that one of them does not have."""

    key: str  # of the campaign file, or of the mechanism after ``mechanism.``
    here: Any
    there: Any
    changes_rows: bool  # False for limits, titles and what else only a report depends on


def plan_keys(store: Store, campaign: str) -> dict[str, Any]:
    """Return the values of a campaign's spec by dotted key, with those that identify its mechanism and build."""
    document = _plan(store, campaign)
    origin = {"mechanism_digest": document.get("mechanism_digest"), "row_build": document.get("row_build")}
    return {**_flat(document["spec"]), **origin}


def plan_differences(store: Store, campaign: str, other_store: Store, other: str) -> list[PlanDifference]:
    """Return what differs between two plans, at most `MOST` keys: first what changes rows, then the rest."""
    plans = (_plan(*each) for each in ((store, campaign), (other_store, other)))
    return table_differences(*map(_content, plans))


def table_differences(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[PlanDifference]:
    """Return what differs between two campaign files as tables, as `plan_differences`."""
    here, there = _flat(one), _flat(other)
    keys = [key for key in dict.fromkeys((*here, *there)) if here.get(key) != there.get(key)]
    irrelevant = set(IRRELEVANT)
    found = [PlanDifference(key, here.get(key), there.get(key), key.split(".")[0] not in irrelevant) for key in keys]
    return sorted(found, key=lambda each: not each.changes_rows)[:MOST]


def shortened(value: Any) -> str:
    """Return a value as JSON, shortened if it is long; a dash if the plan has none."""
    text = "-" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _plan(store: Store, campaign: str) -> dict[str, Any]:
    return parse_plan(store.files.read(f"{campaign}/{PLAN}").decode())[1]


def _content(plan: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a plan says: its campaign file before its mechanism, which may be long."""
    spec = {key: value for key, value in plan["spec"].items() if key != "mechanism"}
    return {**spec, "mechanism": plan.get("mechanism", {}), "row_build": plan.get("row_build")}


def _flat(table: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        flat |= _flat(value, f"{above}{key}.") if isinstance(value, Mapping) else {f"{above}{key}": value}
    return flat
