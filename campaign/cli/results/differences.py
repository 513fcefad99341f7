"""Differences between campaigns with the same title, from their plans."""

import json
from collections import defaultdict
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from campaign.store import Store

MOST_SHOWN = 3  # differences of a campaign in the list
LONGEST = 40  # characters of a value in the list


def add_differences(store: "Store", entries: list[dict[str, Any]]) -> None:
    """Add to campaigns with the same title, as ``differs``, the keys in which their plans differ, with their values.

    Each entry has ``campaign`` and ``title``, which is None if the campaign cannot be read.
    """
    by_title = defaultdict(list)
    for entry in entries:
        if entry["title"] is not None:
            by_title[entry["title"]].append(entry)
    for alike in by_title.values():
        if len(alike) > 1:
            _compare(store, alike)


def in_words(differs: Mapping[str, Any]) -> str:
    """Return the first differences of a campaign in words."""
    shown = [f"{key} = {_shortened(value)}" for key, value in list(differs.items())[:MOST_SHOWN]]
    others = len(differs) - MOST_SHOWN
    return ", ".join(shown) + (f" and {others} more" if others > 0 else "")


def _compare(store: "Store", alike: list[dict[str, Any]]) -> None:
    """Add the differences between these campaigns to each of them."""
    plans = [_keys(store, entry["campaign"]) for entry in alike]
    names = dict.fromkeys(name for plan in plans for name in plan)
    differing = [name for name in names if any(plan.get(name) != plans[0].get(name) for plan in plans)]
    for entry, plan in zip(alike, plans, strict=True):
        entry["differs"] = {name: plan.get(name) for name in differing}


def _keys(store: "Store", campaign_id: str) -> dict[str, Any]:
    """Return the values of a campaign's spec by dotted key, with those that identify its mechanism and build."""
    from campaign.plan_header import parse_plan
    from campaign.store.layout import PLAN

    _, document = parse_plan(store.files.read(f"{campaign_id}/{PLAN}").decode())
    origin = {"mechanism_digest": document.get("mechanism_digest"), "row_build": document.get("row_build")}
    return {**_flat(document["spec"]), **origin}


def _flat(table: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{above}{key}"
        flat |= _flat(value, f"{name}.") if isinstance(value, Mapping) else {name: value}
    return flat


def _shortened(value: Any) -> str:
    """Return a value as JSON, shortened if it is long; a dash if the plan has none."""
    text = "-" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
