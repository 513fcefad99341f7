"""What no single table can see: names that must exist, names used twice, parts that cannot move."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from engine.mechanism.conditions import CONDITION
from engine.mechanism.faults import Fault, did_you_mean

_PAIRED = {
    "joints": (("bearing", "journal"), ("guide", "slider"), ("socket", "ball"), ("a", "b")),
    "contacts": (("a", "b"),),
    "springs": (("a", "b"),),
    "dampers": (("a", "b"),),
    "motions": (("body", "relative_to"),),
}


def reference_faults(data: Mapping[str, Any]) -> list[Fault]:
    """Find every reference to something that is not there.

    Works on plain data, so that a file whose tables have faults of their own is still checked here.

    Parameters
    ----------
    data : mapping
        A mechanism file as read, or a mechanism dumped to plain data.

    Returns
    -------
    list of Fault
        Empty when all is well.
    """
    return [
        *_unknown_names(data),
        *_used_twice(data),
        *_nothing_moves(data),
        *_unknown_laws(data),
        *_unknown_responses(data),
        *_events_of_events(data),
        *_broken_phases(data),
    ]


def _table(data: Any, name: str) -> Mapping[str, Any]:
    """Return a sub-table, empty when it is absent or no table."""
    found = data.get(name) if isinstance(data, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def _phases(data: Mapping[str, Any]) -> list[str]:
    """Return the names of the phases."""
    phases = data.get("phases")
    named = [str(_table({"p": p}, "p").get("name")) for p in phases] if isinstance(phases, list | tuple) else []
    return named or ["run"]


def _sides(table: str, entry: Any) -> tuple[str, str]:
    """Return the keys of the two sides of a joint, contact or spring: those it has."""
    there = entry if isinstance(entry, Mapping) else {}
    return next((pair for pair in _PAIRED[table] if any(side in there for side in pair)), _PAIRED[table][0])


def _references(data: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Yield (kind of thing, key, name) for every name the file refers to."""
    for table in _PAIRED:
        for name, entry in _table(data, table).items():
            for side in _sides(table, entry):
                named = isinstance(entry, Mapping) and isinstance(entry.get(side), str)
                key = f"{table}.{name}.{side}" + ("" if named else ".body")
                yield "body", key, entry[side] if named else _table(entry, side).get("body")
            yield "material", f"{table}.{name}.material", _table({"e": entry}, "e").get("material")
    for name, entry in _table(data, "springs").items():
        actions = _table({"e": entry}, "e").get("actions")
        for i, action in enumerate(actions if isinstance(actions, list | tuple) else ()):
            yield "body", f"springs.{name}.actions.{i}.body", _table({"e": action}, "e").get("body")
    for table in ("forces", "torques", "motions"):
        for name, entry in _table(data, table).items():
            if table != "motions":
                yield "body", f"{table}.{name}.body", _table({"e": entry}, "e").get("body")
            yield "phase", f"{table}.{name}.since", _table({"e": entry}, "e").get("since")
            phases = _table({"e": entry}, "e").get("phases")
            for phase in phases if isinstance(phases, list | tuple) else ():
                yield "phase", f"{table}.{name}.phases", phase
    phases = data.get("phases")
    for i, entry in enumerate(phases if isinstance(phases, list | tuple) else ()):
        yield "response", f"phases.{i}.until.response", _table(_table({"e": entry}, "e"), "until").get("response")
    for axis in ("x", "y"):
        yield "response", f"plot.{axis}", _table(data, "plot").get(axis)
    for name, entry in _table(data, "responses").items():
        yield from _of_response(f"responses.{name}", _table({"e": entry}, "e"))


def _of_response(key: str, entry: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Yield what a response refers to; of a contact of a joint, JOINT.FACE, only the joint is known here."""
    contact = entry.get("contact")
    joint, dot, _ = contact.partition(".") if isinstance(contact, str) else (contact, "", "")
    yield "joint" if dot else "contact", f"{key}.contact", joint
    yield "joint", f"{key}.joint", entry.get("joint")
    yield (
        "torsion spring" if entry.get("type") == "spring_torque" else "linear spring",
        f"{key}.spring",
        entry.get("spring"),
    )
    for end in ("from_phase", "to_phase"):
        yield "phase", f"{key}.{end}", entry.get(end)
    two = entry.get("of")
    for part in two if isinstance(two, list | tuple) else ():
        yield "response", f"{key}.of", part
    yield "response", f"{key}.at.response", _table(entry, "at").get("response")
    for end in ("body", "relative_to"):
        yield "body", f"{key}.{end}", entry.get(end)
    for end in ("from", "to", "direction"):
        yield "body", f"{key}.{end}.body", _table(entry, end).get("body")


def _unknown_names(data: Mapping[str, Any]) -> Iterator[Fault]:
    known = {
        "body": list(_table(data, "bodies")),
        "material": list(_table(data, "materials")),
        "contact": list(_table(data, "contacts")),
        "joint": list(_table(data, "joints")),
        "response": list(_table(data, "responses")),
        "phase": _phases(data),
    }
    for type_ in ("linear", "torsion"):
        springs = _table(data, "springs")
        known[f"{type_} spring"] = [name for name in springs if _table(springs, name).get("type") == type_]
    for kind, key, name in _references(data):
        if isinstance(name, str) and name not in known[kind]:
            there = ", ".join(known[kind]) or "none is defined"
            yield Fault(key, f"no such {kind}; defined here: {there}{did_you_mean(name, known[kind])}", name)


def _used_twice(data: Mapping[str, Any]) -> Iterator[Fault]:
    contacts, joints = _table(data, "contacts"), _table(data, "joints")
    for name in contacts:
        if name in joints:
            yield Fault(f"contacts.{name}", f"joints.{name} has the same name; every name once; rename one of them")
    phases = _phases(data)
    for name in dict.fromkeys(phases):
        if phases.count(name) > 1:
            yield Fault("phases", "two phases have this name; every name once; rename one of them", name)


def _nothing_moves(data: Mapping[str, Any]) -> Iterator[Fault]:
    bodies = _table(data, "bodies")
    fixed = [name for name in bodies if _table(bodies, name).get("fixed") is True]
    if len(fixed) == len(bodies):
        yield Fault("bodies", "no body moves; allowed: at least one without fixed = true; add a moving body")
    for table in _PAIRED:
        for name, entry in _table(data, table).items():
            ends = [_table({"e": entry}, "e").get(side) for side in _sides(table, entry)]
            a, b = (end.get("body") if isinstance(end, Mapping) else end for end in ends)
            if isinstance(a, str) and a == b:
                text = f"both sides are on {a}; allowed: two different bodies; correct one side"
                yield Fault(f"{table}.{name}", text)
            elif a in fixed and (b in fixed or (table == "motions" and b is None)):
                both = f"{a} and {b or 'the world'} are both fixed"
                text = f"{both}; allowed: at least one that moves; remove it, or free one"
                yield Fault(f"{table}.{name}", text)


def pair_between(bodies: Sequence[Any], pairs: Mapping[str, Any]) -> str | None:
    """Return the name of the pair of materials that lies between two bodies' materials, in any order.

    Parameters
    ----------
    bodies : sequence
        The two materials; None where a body has none.
    pairs : mapping
        Name of a pair -> its two materials, or None.
    """
    if None in bodies:
        return None
    return next(
        (name for name, two in pairs.items() if two and sorted(map(str, two)) == sorted(map(str, bodies))), None
    )


def _unknown_laws(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Find contacts whose friction follows from nothing, and pairs of materials that are there twice."""
    materials = _table(data, "materials")
    pairs = {name: _pair(_table(materials, name).get("between")) for name in materials}
    for name, two in pairs.items():
        first = pair_between(two or (None,), pairs)
        if two and first != name:
            text = f"materials.{first} is between the same two; allowed: one pair for two materials; remove one"
            yield Fault(f"materials.{name}.between", text, list(two))
    known = [f"{name} ({' and '.join(two)})" for name, two in pairs.items() if two]
    for table in ("joints", "contacts"):
        for name, entry in _table(data, table).items():
            if not isinstance(entry, Mapping) or any(entry.get(key) is not None for key in ("material", "friction")):
                continue
            if table == "joints" and not str(entry.get("type")).startswith("clearance_"):
                continue  # an ideal joint has no contacts
            sides = [_table(entry, side).get("body") for side in _sides(table, entry)]
            made = [_table(_table(data, "bodies"), str(body)).get("material") for body in sides]
            if pair_between(made, pairs) is None:
                of = " and ".join(f"{a} ({b or 'no material'})" for a, b in zip(sides, made, strict=True))
                there = f"are {', '.join(known)}" if known else "is none"
                text = (
                    f"missing, and no pair of [materials] lies between {of}; with `between` there {there}; "
                    "name a pair, or give friction, or add `between` to a pair"
                )
                yield Fault(f"{table}.{name}.material", text)


def _pair(value: Any) -> tuple[str, str] | None:
    """Return the two names of a `between`, if it is a pair of them."""
    if isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(v, str) for v in value):
        return value[0], value[1]
    return None


def _unknown_responses(data: Mapping[str, Any]) -> Iterator[Fault]:
    known = list(_table(data, "responses"))
    conditions = data.get("validity")
    stated = [("validity", condition) for condition in (conditions if isinstance(conditions, list | tuple) else ())]
    for name, entry in _table(data, "responses").items():
        stated.append((f"responses.{name}.condition", _table({"e": entry}, "e").get("condition", "")))
    for key, condition in stated:
        match = CONDITION.fullmatch(str(condition))
        if match and match[1] not in known:
            there = ", ".join(known) or "none is defined"
            yield Fault(
                key,
                f"no such response; defined here: {there}{did_you_mean(match[1], known)}",
                str(condition),
            )


def _events_of_events(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Find what is read off a response that is no function of time: a peak, an event, or what follows from others."""
    responses = _table(data, "responses")
    phases = data.get("phases")
    watching = [(f"responses.{name}.at.response", _table(_table(responses, name), "at")) for name in responses]
    for i, phase in enumerate(phases if isinstance(phases, list | tuple) else ()):
        watching.append((f"phases.{i}.until.response", _table(_table({"p": phase}, "p"), "until")))
    for key, at in watching:
        watched = at.get("response")
        if isinstance(watched, str) and _table(responses, watched).get("at", "end") != "end":
            text = (
                f"responses.{watched} is itself read at a peak or an event; allowed: responses with "
                'at = "end"; watch one of the same kind without at'
            )
            yield Fault(key, text, watched)
        elif isinstance(watched, str) and _follows(_table(responses, watched)):
            yield Fault(
                key,
                f"responses.{watched} is known only after the run; allowed: what is measured at each step; "
                "watch one it follows from",
                watched,
            )
    for name in responses:
        two = _table(responses, name).get("of")
        named = [part for part in two if isinstance(part, str)] if isinstance(two, list | tuple) else []
        match = CONDITION.fullmatch(str(_table(responses, name).get("condition", "")))
        for part in [*named, *([match[1]] if match else [])]:
            if _table(responses, part).get("type") in ("difference", "condition"):
                text = f"responses.{part} follows from others; allowed: what is measured; name what it is made of"
                yield Fault(f"responses.{name}.{'of' if named else 'condition'}", text, part)


def _follows(response: Mapping[str, Any]) -> bool:
    """Say whether a response is computed after the run."""
    return response.get("type") in ("difference", "condition") or response.get("bound") is not None


def _broken_phases(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Find motions that stop and start again, and laws that begin before their motion does."""
    order = _phases(data)
    for name, entry in _table(data, "motions").items():
        named = _table({"e": entry}, "e").get("phases")
        at = sorted({order.index(p) for p in named if p in order}) if isinstance(named, list | tuple) else []
        if at and at[-1] - at[0] >= len(at):
            text = "a motion is not taken up again; allowed: phases that follow each other; write two motions"
            yield Fault(f"motions.{name}.phases", text, list(named or ()))
        since = _table({"e": entry}, "e").get("since")
        if at and since in order and order.index(since) < at[0]:
            text = f"the motion begins with {order[at[0]]}, after its law; allowed: {order[at[0]]} or later; remove it"
            yield Fault(f"motions.{name}.since", text, since)
