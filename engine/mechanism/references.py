"""Faults that no single table shows: missing names, names used twice, parts that cannot move, phases and events."""

from collections.abc import Iterator, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import Any

from engine.errors import Fault
from engine.mechanism.expression import names_in_text
from engine.mechanism.faults import as_table, did_you_mean, list_under, named_tables, phase_names, sub_table
from engine.mechanism.materials import EXPANSIONS, expansion_of
from engine.mechanism.responses import CONDITION, in_formulas

_PAIRED = {
    "joints": (("bearing", "journal"), ("guide", "slider"), ("socket", "ball"), ("a", "b")),
    "contacts": (("a", "b"),),
    "springs": (("a", "b"),),
    "dampers": (("a", "b"),),
    "motions": (("body", "relative_to"),),
    "forces": (("body", "against"),),
    "torques": (("body", "against"),),
}

_ADDED_UP = ("impulse", "mean")
_WITH_COORDINATES = ("revolute", "prismatic", "cylindrical")
_COORDINATES = ("position", "velocity", "angle", "angular_velocity")
_DERIVED = ("difference", "condition", "formula")

Reference = tuple[str, tuple[str, ...], Any]
"""The kind of object that is referred to, the key that refers to it, and the object's name."""


def reference_faults(data: Mapping[str, Any]) -> list[Fault]:
    """Find every reference to something that does not exist, in plain data: a file with faults is checked, too."""
    return [
        *_unknown_names(data),
        *_used_twice(data),
        *_nothing_moves(data),
        *_unknown_coordinates(data),
        *_unknown_expansions(data),
        *_unknown_laws(data),
        *_springs_without_projection(data),
        *_unknown_responses(data),
        *_derived_faults(data),
        *events_of_events(data),
        *broken_phases(data),
    ]


def _springs_without_projection(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield each stiffness of a contact, a joint, a stop or teeth that the plain scheme does not compute."""
    if sub_table(data, "simulation").get("scheme") != "moreau_jean":
        return
    contacts = [("contacts", name, entry) for name, entry in named_tables(data, "contacts").items()]
    stops = [("joints", name, sub_table(entry, "limits")) for name, entry in named_tables(data, "joints").items()]
    gears = [("couplings", name, entry) for name, entry in named_tables(data, "couplings").items()]
    for name, entry in named_tables(data, "joints").items():
        if entry.get("type") in ("bushing", "beam"):
            text = "the scheme moreau_jean has rigid joints only; allowed: fixed; make it one, or remove the scheme"
            yield Fault(("joints", name, "type"), text, entry["type"])
        if entry.get("ring_stiffness") is not None:
            text = "the scheme moreau_jean has rigid rings only; allowed: none; remove it, or the scheme"
            yield Fault(("joints", name, "ring_stiffness"), text, entry["ring_stiffness"])
    pairs = [("materials", name, entry) for name, entry in named_tables(data, "materials").items()]
    for table, name, entry in (*contacts, *pairs):
        for word in ("rolling_friction", "spinning_friction"):
            if entry.get(word):
                text = "the scheme moreau_jean has no moments in contacts; allowed: none; remove it, or the scheme"
                yield Fault((table, name, word), text, entry[word])
    for table, name, entry in (*contacts, *stops, *gears):
        for word in ("stiffness", "hertz_stiffness"):
            if entry.get(word) is not None:
                key = (table, name, *(("limits",) if table == "joints" else ()), word)
                text = "the scheme moreau_jean has rigid contacts only; allowed: none; remove it, or the scheme"
                yield Fault(key, text, entry[word])


def _sides(table: str, entry: Mapping[str, Any]) -> tuple[str, str]:
    """Return the keys of the two sides of a joint, contact or spring that has them."""
    return next((pair for pair in _PAIRED[table] if any(side in entry for side in pair)), _PAIRED[table][0])


def _references(data: Mapping[str, Any]) -> Iterator[Reference]:
    """Yield every name that the file refers to."""
    for table in _PAIRED:
        for name, entry in named_tables(data, table).items():
            yield from _of_pair(table, (table, name), entry)
    for name, entry in named_tables(data, "springs").items():
        for i, action in enumerate(list_under(entry, "actions")):
            yield "body", ("springs", name, "actions", str(i), "body"), as_table(action).get("body")
    for table in ("forces", "torques", "motions"):
        for name, entry in named_tables(data, table).items():
            yield "coordinate", (table, name, "law", "over"), sub_table(entry, "law").get("over")
            yield "phase", (table, name, "since"), entry.get("since")
            for phase in list_under(entry, "phases"):
                yield "phase", (table, name, "phases"), phase
    for name, entry in named_tables(data, "couplings").items():
        for i, term in enumerate(list_under(entry, "terms")):
            key = ("couplings", name, "terms", str(i), "joint")
            yield "ideal joint with one or two coordinates", key, as_table(term).get("joint")
        for i, gear in enumerate(list_under(entry, "gears")):
            yield "body", ("couplings", name, "gears", str(i), "body"), as_table(gear).get("body")
    for i, phase in enumerate(list_under(data, "phases")):
        yield "response", ("phases", str(i), "until", "response"), sub_table(phase, "until").get("response")
    for axis in ("x", "y"):
        yield "response", ("plot", axis), sub_table(data, "plot").get(axis)
    for name, entry in named_tables(data, "responses").items():
        yield from _of_response(("responses", name), entry)


def _of_pair(table: str, key: tuple[str, ...], entry: Mapping[str, Any]) -> Iterator[Reference]:
    """Yield the two bodies and the material of a joint, contact, spring, damper or motion."""
    for side in _sides(table, entry):
        if isinstance(entry.get(side), str):
            yield "body", (*key, side), entry[side]
        else:
            yield "body", (*key, side, "body"), sub_table(entry, side).get("body")
    yield "material", (*key, "material"), entry.get("material")


def _of_response(key: tuple[str, ...], entry: Mapping[str, Any]) -> Iterator[Reference]:
    """Yield the names in a response; for a contact of a joint, JOINT.FACE, only the joint can be checked here."""
    contact = entry.get("contact")
    joint, dot, _ = contact.partition(".") if isinstance(contact, str) else (contact, "", "")
    yield "owner" if dot else "contact", (*key, "contact"), joint
    yield "joint", (*key, "joint"), entry.get("joint")
    spring = "torsion spring" if entry.get("type") == "spring_torque" else "linear spring"
    yield spring, (*key, "spring"), entry.get("spring")
    motion = {"motion_force": "translation", "motion_torque": "rotation"}.get(str(entry.get("type")), "motion")
    yield motion, (*key, "motion"), entry.get("motion")
    yield "response", (*key, "response"), entry.get("response")
    for end in ("from_phase", "to_phase"):
        yield "phase", (*key, end), entry.get(end)
    for part in list_under(entry, "of"):
        yield "response", (*key, "of"), part
    yield "response", (*key, "at", "response"), sub_table(entry, "at").get("response")
    for end in ("body", "relative_to"):
        yield "body", (*key, end), entry.get(end)
    for end in ("from", "to", "direction"):
        yield "body", (*key, end, "body"), sub_table(entry, end).get("body")


def _unknown_names(data: Mapping[str, Any]) -> Iterator[Fault]:
    springs, motions = named_tables(data, "springs"), named_tables(data, "motions")
    defined = {
        "body": list(sub_table(data, "bodies")),
        "material": list(sub_table(data, "materials")),
        "contact": list(sub_table(data, "contacts")),
        "joint": list(sub_table(data, "joints")),
        "owner": [*sub_table(data, "joints"), *sub_table(data, "couplings")],
        "ideal joint with one or two coordinates": [
            name for name, joint in named_tables(data, "joints").items() if joint.get("type") in _WITH_COORDINATES
        ],
        "response": list(sub_table(data, "responses")),
        "coordinate": [
            name for name, response in named_tables(data, "responses").items() if response.get("type") in _COORDINATES
        ],
        "phase": phase_names(data),
        "motion": list(motions),
        "translation": [name for name, motion in motions.items() if "along" in motion],
        "rotation": [name for name, motion in motions.items() if "about" in motion],
        "linear spring": [name for name, spring in springs.items() if spring.get("type") == "linear"],
        "torsion spring": [name for name, spring in springs.items() if spring.get("type") == "torsion"],
    }
    owner = "joint or coupling" if sub_table(data, "couplings") else "joint"
    for kind, key, name in _references(data):
        if isinstance(name, str) and name not in defined[kind]:
            names = ", ".join(defined[kind]) or "none is defined"
            what = owner if kind == "owner" else kind
            yield Fault(key, f"no such {what}; defined here: {names}{did_you_mean(name, defined[kind])}", name)


def _used_twice(data: Mapping[str, Any]) -> Iterator[Fault]:
    contacts, joints = sub_table(data, "contacts"), sub_table(data, "joints")
    for name in contacts:
        if name in joints:
            yield Fault(("contacts", name), f"joints.{name} has the same name; every name once; rename one of them")
    for name in sub_table(data, "couplings"):
        if name in joints or name in contacts:
            other = f"{'joints' if name in joints else 'contacts'}.{name}"
            yield Fault(("couplings", name), f"{other} has the same name; every name once; rename one of them")
    phases = phase_names(data)
    for name in dict.fromkeys(phases):
        if phases.count(name) > 1:
            yield Fault(("phases",), "two phases have this name; every name once; rename one of them", name)


def _nothing_moves(data: Mapping[str, Any]) -> Iterator[Fault]:
    bodies = named_tables(data, "bodies")
    fixed = [name for name, body in bodies.items() if body.get("fixed") is True]
    if len(fixed) == len(bodies):
        yield Fault(("bodies",), "no body moves; allowed: at least one without fixed = true; add a moving body")
    for table in (*_PAIRED, "couplings"):
        for name, entry in named_tables(data, table).items():
            gears = list_under(entry, "gears") if table == "couplings" else None
            if gears is not None and len(gears) != 2:
                continue
            ends = [entry.get(side) for side in _sides(table, entry)] if gears is None else gears
            a, b = (end.get("body") if isinstance(end, Mapping) else end for end in ends)
            if isinstance(a, str) and a == b:
                text = f"both sides are on {a}; allowed: two different bodies; correct one side"
                yield Fault((table, name), text)
            elif a in fixed and (b in fixed or (table == "motions" and b is None)):
                both = f"{a} and {b or 'the world'} are both fixed"
                text = f"{both}; allowed: at least one that moves; remove it, or free one"
                yield Fault((table, name), text)


def _unknown_coordinates(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield faults where a coupling leaves open which coordinate of a joint it means, or means one that it has not."""
    joints = named_tables(data, "joints")
    only = {"revolute": "angle", "prismatic": "travel"}
    for name, entry in named_tables(data, "couplings").items():
        for i, term in enumerate(map(as_table, list_under(entry, "terms"))):
            joint, of = term.get("joint"), term.get("of")
            kind = sub_table(joints, joint).get("type") if isinstance(joint, str) else None
            key = ("couplings", name, "terms", str(i), "of")
            if kind == "cylindrical" and of is None:
                text = f"missing; {joint} turns and slides; allowed: angle, travel; say which of the two"
                yield Fault(key, text)
            elif kind in only and of not in (None, only[kind]):
                yield Fault(key, f"{joint} has only its {only[kind]}; allowed: {only[kind]}; remove it", of)


def _unknown_expansions(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield a fault for each body of which nothing says how it expands, if the mechanism has a temperature."""
    for name, body in named_tables(data, "bodies").items() if data.get("temperature") is not None else ():
        made = body.get("material")
        if body.get("expansion") is None and (not isinstance(made, str) or expansion_of(made) is None):
            meant = did_you_mean(made, EXPANSIONS) if isinstance(made, str) else ""
            text = (
                f"missing, and {made or 'no material'} is not in the table of materials; allowed: a coefficient in 1/K,"
                f" or a material of the body such as {', '.join([*EXPANSIONS][:4])} or POM{meant}; give one of the two"
            )
            yield Fault(("bodies", name, "expansion"), text)


def pair_between(bodies: Sequence[Any], pairs: Mapping[str, Any]) -> str | None:
    """Return the name of the material pair for the materials of two bodies, in either order; None if there is none.

    ``bodies`` holds None for a body without a material, and ``pairs`` for one that does not name two materials.
    """
    if None in bodies:
        return None
    return next(
        (name for name, two in pairs.items() if two and sorted(map(str, two)) == sorted(map(str, bodies))), None
    )


def _unknown_laws(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield faults for contacts whose friction is not defined, and for two pairs of the same materials."""
    pairs = {name: _pair(material.get("between")) for name, material in named_tables(data, "materials").items()}
    for name, two in pairs.items():
        first = pair_between(two or (None,), pairs)
        if two and first != name:
            text = f"materials.{first} is between the same two; allowed: one pair for two materials; remove one"
            yield Fault(("materials", name, "between"), text, list(two))
    with_between = [f"{name} ({' and '.join(two)})" for name, two in pairs.items() if two]
    bodies = sub_table(data, "bodies")
    for key, sides in _lawless(data):
        made = [sub_table(bodies, str(body)).get("material") for body in sides]
        if pair_between(made, pairs) is None:
            of = " and ".join(f"{a} ({b or 'no material'})" for a, b in zip(sides, made, strict=True))
            others = f"are {', '.join(with_between)}" if with_between else "is none"
            text = (
                f"missing, and no pair of [materials] lies between {of}; with `between` there {others}; "
                "name a pair, or give friction, or add `between` to a pair"
            )
            yield Fault((*key, "material"), text)


def _lawless(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, str], list[Any]]]:
    """Yield key and bodies of the contacts, and joints with clearance, that give neither a material nor friction."""
    for table in ("joints", "contacts"):
        for name, entry in sub_table(data, table).items():
            if not isinstance(entry, Mapping) or any(entry.get(key) is not None for key in ("material", "friction")):
                continue
            if table == "joints" and not str(entry.get("type")).startswith("clearance_"):
                continue  # an ideal joint has no contacts
            yield (table, name), [sub_table(entry, side).get("body") for side in _sides(table, entry)]


def _pair(value: Any) -> tuple[str, str] | None:
    """Return the two names in a `between` if it is a pair of names."""
    if isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(v, str) for v in value):
        return value[0], value[1]
    return None


def _unknown_responses(data: Mapping[str, Any]) -> Iterator[Fault]:
    responses = named_tables(data, "responses")
    defined = list(responses)
    stated = [(("responses", name, "condition"), entry.get("condition", "")) for name, entry in responses.items()]
    for key, condition in [*((("validity",), condition) for condition in list_under(data, "validity")), *stated]:
        match = CONDITION.fullmatch(str(condition))
        if match and match[1] not in defined:
            names = ", ".join(defined) or "none is defined"
            text = f"no such response; defined here: {names}{did_you_mean(match[1], defined)}"
            yield Fault(key, text, str(condition))


def _derived_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield faults: names in formulas that mean nothing or two things, and a response that follows from itself."""
    responses, parameters = named_tables(data, "responses"), sub_table(data, "parameters")
    known, needs = in_formulas(responses), {}
    for name, entry in responses.items():
        match = CONDITION.fullmatch(str(entry.get("condition", "")))
        parts = [part for part in list_under(entry, "of") if isinstance(part, str)]
        used = [*parts, *([match[1]] if match else [])]
        if entry.get("type") == "formula" and isinstance(entry.get("formula"), str):
            in_text = list(dict.fromkeys(names_in_text(entry["formula"])))
            key = ("responses", name, "formula")
            yield from (Fault(key, text) for part in in_text if (text := _meaningless(part, known, parameters)))
            used = [known[part] for part in in_text if part in known]
        needs[name] = used
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as error:
        circle = error.args[1][::-1]
        way = " -> ".join(circle[:10])
        yield Fault(("responses", circle[0]), f"follows from itself: {way}; allowed: no circle; name what is measured")


def _meaningless(part: str, known: Mapping[str, str], parameters: Mapping[str, Any]) -> str:
    """Return why a name in a formula means nothing, or two things; empty if it means one."""
    if part in known and part in parameters:
        return f"{part} is both a response and a parameter; allowed: one of them; rename the parameter"
    if part in known or part in parameters:
        return ""
    names = [*known, *parameters]
    there = f"{', '.join(names[:20])}{did_you_mean(part, names)}"
    return f"{part} is no response and no parameter; defined here: {there}"


def events_of_events(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield faults where an event, peak, impulse, mean or plot refers to a response without a value at each step."""
    responses, plot = named_tables(data, "responses"), sub_table(data, "plot")
    watching: list[tuple[tuple[str, ...], Any]] = [
        *((("responses", name, "at", "response"), sub_table(entry, "at")) for name, entry in responses.items()),
        *((("responses", name, "response"), entry) for name, entry in responses.items()),
        *(
            (("phases", str(i), "until", "response"), sub_table(phase, "until"))
            for i, phase in enumerate(list_under(data, "phases"))
        ),
        *((("plot", axis), {"response": plot.get(axis), "drawn": True}) for axis in ("x", "y")),
    ]
    for key, at in watching:
        watched = at.get("response")
        response = sub_table(responses, watched) if isinstance(watched, str) else {}
        if "drawn" in at and not _follows(response):
            continue  # whenever it is read, it has a value in each step
        if response.get("at", "end") != "end":
            text = 'itself read at a peak or an event; allowed: responses with at = "end"; watch one of the same kind'
            text += " without at"
        elif "type" in at and response.get("type") in _ADDED_UP:
            text = "itself added up; allowed: what is measured in each step; name what it adds up"
        elif _follows(response):
            text = "known only after the run; allowed: what is measured at each step; watch one it follows from"
        else:
            continue
        yield Fault(key, f"responses.{watched} is {text}", watched)


def _follows(response: Mapping[str, Any]) -> bool:
    """Return whether a response is computed after the run."""
    return response.get("type") in _DERIVED or response.get("bound") is not None


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
