"""What no single table can see: names that must exist, names used twice, parts that cannot move."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from engine.mechanism.conditions import CONDITION
from engine.mechanism.faults import Fault, did_you_mean
from engine.mechanism.phase_checks import broken_phases, events_of_events
from engine.mechanism.tables import phase_names, sub_table

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
        *events_of_events(data),
        *broken_phases(data),
    ]


def _sides(table: str, entry: Any) -> tuple[str, str]:
    """Return the keys of the two sides of a joint, contact or spring: those it has."""
    there = entry if isinstance(entry, Mapping) else {}
    return next((pair for pair in _PAIRED[table] if any(side in there for side in pair)), _PAIRED[table][0])


def _references(data: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Yield (kind of thing, key, name) for every name the file refers to."""
    for table in _PAIRED:
        for name, entry in sub_table(data, table).items():
            for side in _sides(table, entry):
                named = isinstance(entry, Mapping) and isinstance(entry.get(side), str)
                key = f"{table}.{name}.{side}" + ("" if named else ".body")
                yield "body", key, entry[side] if named else sub_table(entry, side).get("body")
            yield "material", f"{table}.{name}.material", sub_table({"e": entry}, "e").get("material")
    for name, entry in sub_table(data, "springs").items():
        actions = sub_table({"e": entry}, "e").get("actions")
        for i, action in enumerate(actions if isinstance(actions, list | tuple) else ()):
            yield "body", f"springs.{name}.actions.{i}.body", sub_table({"e": action}, "e").get("body")
    for table in ("forces", "torques", "motions"):
        for name, entry in sub_table(data, table).items():
            if table != "motions":
                yield "body", f"{table}.{name}.body", sub_table({"e": entry}, "e").get("body")
            yield "phase", f"{table}.{name}.since", sub_table({"e": entry}, "e").get("since")
            phases = sub_table({"e": entry}, "e").get("phases")
            for phase in phases if isinstance(phases, list | tuple) else ():
                yield "phase", f"{table}.{name}.phases", phase
    phases = data.get("phases")
    for i, entry in enumerate(phases if isinstance(phases, list | tuple) else ()):
        yield "response", f"phases.{i}.until.response", sub_table(sub_table({"e": entry}, "e"), "until").get("response")
    for axis in ("x", "y"):
        yield "response", f"plot.{axis}", sub_table(data, "plot").get(axis)
    for name, entry in sub_table(data, "responses").items():
        yield from _of_response(f"responses.{name}", sub_table({"e": entry}, "e"))


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
    yield "response", f"{key}.at.response", sub_table(entry, "at").get("response")
    for end in ("body", "relative_to"):
        yield "body", f"{key}.{end}", entry.get(end)
    for end in ("from", "to", "direction"):
        yield "body", f"{key}.{end}.body", sub_table(entry, end).get("body")


def _unknown_names(data: Mapping[str, Any]) -> Iterator[Fault]:
    known = {
        "body": list(sub_table(data, "bodies")),
        "material": list(sub_table(data, "materials")),
        "contact": list(sub_table(data, "contacts")),
        "joint": list(sub_table(data, "joints")),
        "response": list(sub_table(data, "responses")),
        "phase": phase_names(data),
    }
    for type_ in ("linear", "torsion"):
        springs = sub_table(data, "springs")
        known[f"{type_} spring"] = [name for name in springs if sub_table(springs, name).get("type") == type_]
    for kind, key, name in _references(data):
        if isinstance(name, str) and name not in known[kind]:
            there = ", ".join(known[kind]) or "none is defined"
            yield Fault(key, f"no such {kind}; defined here: {there}{did_you_mean(name, known[kind])}", name)


def _used_twice(data: Mapping[str, Any]) -> Iterator[Fault]:
    contacts, joints = sub_table(data, "contacts"), sub_table(data, "joints")
    for name in contacts:
        if name in joints:
            yield Fault(f"contacts.{name}", f"joints.{name} has the same name; every name once; rename one of them")
    phases = phase_names(data)
    for name in dict.fromkeys(phases):
        if phases.count(name) > 1:
            yield Fault("phases", "two phases have this name; every name once; rename one of them", name)


def _nothing_moves(data: Mapping[str, Any]) -> Iterator[Fault]:
    bodies = sub_table(data, "bodies")
    fixed = [name for name in bodies if sub_table(bodies, name).get("fixed") is True]
    if len(fixed) == len(bodies):
        yield Fault("bodies", "no body moves; allowed: at least one without fixed = true; add a moving body")
    for table in _PAIRED:
        for name, entry in sub_table(data, table).items():
            ends = [sub_table({"e": entry}, "e").get(side) for side in _sides(table, entry)]
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
    materials = sub_table(data, "materials")
    pairs = {name: _pair(sub_table(materials, name).get("between")) for name in materials}
    for name, two in pairs.items():
        first = pair_between(two or (None,), pairs)
        if two and first != name:
            text = f"materials.{first} is between the same two; allowed: one pair for two materials; remove one"
            yield Fault(f"materials.{name}.between", text, list(two))
    known = [f"{name} ({' and '.join(two)})" for name, two in pairs.items() if two]
    for table in ("joints", "contacts"):
        for name, entry in sub_table(data, table).items():
            if not isinstance(entry, Mapping) or any(entry.get(key) is not None for key in ("material", "friction")):
                continue
            if table == "joints" and not str(entry.get("type")).startswith("clearance_"):
                continue  # an ideal joint has no contacts
            sides = [sub_table(entry, side).get("body") for side in _sides(table, entry)]
            made = [sub_table(sub_table(data, "bodies"), str(body)).get("material") for body in sides]
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
    known = list(sub_table(data, "responses"))
    conditions = data.get("validity")
    stated = [("validity", condition) for condition in (conditions if isinstance(conditions, list | tuple) else ())]
    for name, entry in sub_table(data, "responses").items():
        stated.append((f"responses.{name}.condition", sub_table({"e": entry}, "e").get("condition", "")))
    for key, condition in stated:
        match = CONDITION.fullmatch(str(condition))
        if match and match[1] not in known:
            there = ", ".join(known) or "none is defined"
            yield Fault(
                key,
                f"no such response; defined here: {there}{did_you_mean(match[1], known)}",
                str(condition),
            )
