"""What no single table can see of the course of a run: events, and motions that come and go with phases."""

from collections.abc import Iterator, Mapping
from typing import Any

from engine.mechanism.conditions import CONDITION
from engine.mechanism.faults import Fault
from engine.mechanism.tables import phase_names, sub_table


def events_of_events(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Find what is read off a response that is no function of time: a peak, an event, or what follows from others."""
    responses = sub_table(data, "responses")
    phases = data.get("phases")
    watching = [(f"responses.{name}.at.response", sub_table(sub_table(responses, name), "at")) for name in responses]
    for i, phase in enumerate(phases if isinstance(phases, list | tuple) else ()):
        watching.append((f"phases.{i}.until.response", sub_table(sub_table({"p": phase}, "p"), "until")))
    for key, at in watching:
        watched = at.get("response")
        if isinstance(watched, str) and sub_table(responses, watched).get("at", "end") != "end":
            text = (
                f"responses.{watched} is itself read at a peak or an event; allowed: responses with "
                'at = "end"; watch one of the same kind without at'
            )
            yield Fault(key, text, watched)
        elif isinstance(watched, str) and _follows(sub_table(responses, watched)):
            yield Fault(
                key,
                f"responses.{watched} is known only after the run; allowed: what is measured at each step; "
                "watch one it follows from",
                watched,
            )
    for name in responses:
        two = sub_table(responses, name).get("of")
        named = [part for part in two if isinstance(part, str)] if isinstance(two, list | tuple) else []
        match = CONDITION.fullmatch(str(sub_table(responses, name).get("condition", "")))
        for part in [*named, *([match[1]] if match else [])]:
            if sub_table(responses, part).get("type") in ("difference", "condition"):
                text = f"responses.{part} follows from others; allowed: what is measured; name what it is made of"
                yield Fault(f"responses.{name}.{'of' if named else 'condition'}", text, part)


def _follows(response: Mapping[str, Any]) -> bool:
    """Say whether a response is computed after the run."""
    return response.get("type") in ("difference", "condition") or response.get("bound") is not None


def broken_phases(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Find motions that stop and start again, laws before their motion, searches that end before they begin."""
    order = phase_names(data)
    for name, entry in sub_table(data, "responses").items():
        first, last = (sub_table({"e": entry}, "e").get(key) for key in ("from_phase", "to_phase"))
        if first in order and last in order and order.index(last) < order.index(first):
            text = f"{last} comes before {first}, where the search begins; allowed: {first} or later; exchange them"
            yield Fault(f"responses.{name}.to_phase", text, last)
    for name, entry in sub_table(data, "motions").items():
        named = sub_table({"e": entry}, "e").get("phases")
        at = sorted({order.index(p) for p in named if p in order}) if isinstance(named, list | tuple) else []
        if at and at[-1] - at[0] >= len(at):
            text = "a motion is not taken up again; allowed: phases that follow each other; write two motions"
            yield Fault(f"motions.{name}.phases", text, list(named or ()))
        since = sub_table({"e": entry}, "e").get("since")
        if at and since in order and order.index(since) < at[0]:
            text = f"the motion begins with {order[at[0]]}, after its law; allowed: {order[at[0]]} or later; remove it"
            yield Fault(f"motions.{name}.since", text, since)
