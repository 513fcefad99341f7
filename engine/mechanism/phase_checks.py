"""Faults in the course of a run that no single table shows: in its events, and in its motions and their phases."""

from collections.abc import Iterator, Mapping
from typing import Any

from engine.faults.fault import Fault
from engine.mechanism.conditions import CONDITION
from engine.mechanism.tables import list_under, named_tables, phase_names, sub_table


def events_of_events(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield faults where an event, peak, difference or condition refers to a response without a value at each step."""
    responses = named_tables(data, "responses")
    watching: list[tuple[tuple[str, ...], Any]] = [
        (("responses", name, "at", "response"), sub_table(entry, "at")) for name, entry in responses.items()
    ]
    for i, phase in enumerate(list_under(data, "phases")):
        watching.append((("phases", str(i), "until", "response"), sub_table(phase, "until")))
    for key, at in watching:
        watched = at.get("response")
        if isinstance(watched, str) and sub_table(responses, watched).get("at", "end") != "end":
            text = (
                f"responses.{watched} is itself read at a peak or an event; allowed: responses with "
                'at = "end"; watch one of the same kind without at'
            )
            yield Fault(key, text, watched)
        elif isinstance(watched, str) and _follows(sub_table(responses, watched)):
            text = (
                f"responses.{watched} is known only after the run; allowed: what is measured at each step; "
                "watch one it follows from"
            )
            yield Fault(key, text, watched)
    for name, entry in responses.items():
        parts = [part for part in list_under(entry, "of") if isinstance(part, str)]
        match = CONDITION.fullmatch(str(entry.get("condition", "")))
        for part in [*parts, *([match[1]] if match else [])]:
            if sub_table(responses, part).get("type") in ("difference", "condition"):
                text = f"responses.{part} follows from others; allowed: what is measured; name what it is made of"
                yield Fault(("responses", name, "of" if parts else "condition"), text, part)


def _follows(response: Mapping[str, Any]) -> bool:
    """Return whether a response is computed after the run."""
    return response.get("type") in ("difference", "condition") or response.get("bound") is not None


def broken_phases(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield faults: motions that resume after a pause, laws before their motion, searches ending before their start."""
    order = phase_names(data)
    for name, entry in named_tables(data, "responses").items():
        first, last = entry.get("from_phase"), entry.get("to_phase")
        if first in order and last in order and order.index(last) < order.index(first):
            text = f"{last} comes before {first}, where the search begins; allowed: {first} or later; exchange them"
            yield Fault(("responses", name, "to_phase"), text, last)
    for name, entry in named_tables(data, "motions").items():
        phases, since = list_under(entry, "phases"), entry.get("since")
        at = sorted({order.index(phase) for phase in phases if phase in order})
        if at and at[-1] - at[0] >= len(at):
            text = "a motion is not taken up again; allowed: phases that follow each other; write two motions"
            yield Fault(("motions", name, "phases"), text, list(phases))
        if at and since in order and order.index(since) < at[0]:
            text = f"the motion begins with {order[at[0]]}, after its law; allowed: {order[at[0]]} or later; remove it"
            yield Fault(("motions", name, "since"), text, since)
