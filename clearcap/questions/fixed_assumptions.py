"""The quantities that stay fixed during a campaign: contact laws, clearances, loads, masses, settings of the runs.

The shape of the parts is left out, because the mechanism file and the picture show it. Quantities that vary are left
out too, because they are in the report's table of inputs.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from campaign.plan import Plan
from engine.errors import MechanismError
from engine.mechanism import Mechanism, full_key, set_values, unit_of
from engine.mechanism.base import TableModel, declared
from engine.mechanism.bushings import Yielding
from engine.mechanism.faults import field_of
from engine.mechanism.quantities import Quantity
from engine.mechanism.references import pair_between
from reporting import Assumption

GENERAL, CONTACT, PLAY = "Settings of the runs", "Friction and impact", "Clearances and offsets"
PARAMETERS = "Parameters"
LOADS, MASSES, PHASES = "Springs, dampers, forces and motions", "Masses", "Phases"
_COMPONENTS = ("x", "y", "z")
_LOADS = {"springs": "spring", "dampers": "damper", "forces": "force", "torques": "torque", "motions": "motion"}
_SETTINGS = {
    "simulation.tolerance": "relative residual of the friction problem",
    "simulation.penetration": "largest gap violation after a step",
    "simulation.adaptive.longest": "longest step while everything is slow",
    "simulation.rest.window": "at rest if nothing moves for",
    "simulation.rest.drift": "at rest if nothing moves by more than",
}
_RUBBING = ("friction_force", "breakaway_force", "friction_torque", "breakaway_torque")  # of ideal joints
_NAMES_SHOWN = 6  # number of joints and contacts listed for a material


def fixed_assumptions(plan: Plan) -> tuple[Assumption, ...]:
    """Return the assumptions that are the same in every run of a campaign, by group."""
    mechanism, varies = plan.mechanism, _varies(plan)
    found = list(_general(plan))
    found += [_number(mechanism, PARAMETERS, n, value, f"parameters.{n}") for n, value in mechanism.parameters.items()]
    found += [*_contact_laws(mechanism), *_plays(mechanism)]
    for name, joint in mechanism.joints.items():
        if isinstance(joint, Yielding):
            found += _entries(mechanism, joint, LOADS, f"joint {name}", f"joints.{name}")
    for table, kind in _LOADS.items():
        for name, load in getattr(mechanism, table).items():
            found += _entries(mechanism, load, LOADS, f"{kind} {name}", f"{table}.{name}")
    found += _masses(mechanism)
    for i, phase in enumerate(mechanism.phases):
        found += _entries(mechanism, phase, PHASES, f"phase {phase.name}", f"phases.{i}")
    return tuple(fixed for each in found for fixed in _without_what_varies(each, varies))


def _varies(plan: Plan) -> Callable[[str], bool]:
    """Return a function that tells whether any variable of a campaign changes the value of a key.

    A variable may determine several numbers of the file, so the numbers of two mechanisms are compared.
    """
    centre, away = dict[str, float](), dict[str, float]()
    for name, key in plan.targets.items():
        mean, std = plan.spec.variables[name].moments()
        centre[key], away[key] = mean, mean + 1e-3 * (std or abs(mean) or 1.0)
    try:
        one, other = (dict(_leaves(set_values(plan.mechanism, values), "")) for values in (centre, away))
    except MechanismError:  # a discrete variable, or parts that would overlap: only the keys themselves are known
        one, other = {}, {}
    changed = {key for key in one.keys() | other.keys() if one.get(key) != other.get(key)}
    changed |= {full_key(plan.mechanism, key) for key in plan.targets.values()}
    return lambda key: key in changed


def _leaves(node: Any, prefix: str) -> Iterator[tuple[str, float]]:
    """Yield the dotted path and the value of every number below a node, including the components of vectors."""
    if isinstance(node, float):
        yield prefix, node
        return
    if isinstance(node, TableModel):
        items = list(node.entries().items())
    elif isinstance(node, tuple):
        items = (
            list(zip(_COMPONENTS, node, strict=True)) if _is_vector(node) else [(str(i), x) for i, x in enumerate(node)]
        )
    else:
        items = list(node.items()) if isinstance(node, dict) else []
    for token, child in items:
        if token not in ("benches", "presets"):
            yield from _leaves(child, f"{prefix}.{token}" if prefix else token)


def _without_what_varies(assumption: Assumption, varies: Callable[[str], bool]) -> Iterator[Assumption]:
    """Yield an assumption unless it varies; for a vector with a varying component, yield the other components."""
    keys = [f"{assumption.key}.{component}" for component in _COMPONENTS]
    if isinstance(assumption.value, tuple) and any(map(varies, keys)):
        for key, component, number in zip(keys, _COMPONENTS, assumption.value, strict=True):
            if not varies(key):
                yield replace(assumption, name=f"{assumption.name}, {component}", value=number, key=key)
    elif not varies(assumption.key):
        yield assumption


def _general(plan: Plan) -> Iterator[Assumption]:
    mechanism, settings = plan.mechanism, plan.spec.simulation
    simulation, time = mechanism.simulation, mechanism.unit("time")
    yield Assumption(GENERAL, "system of units", mechanism.units, "", "units")
    for name, text in (("test bench", plan.spec.bench), ("preset", plan.spec.preset)):
        if text:
            yield Assumption(GENERAL, name, text, "", "")
    yield _vector(mechanism, GENERAL, "gravity", "gravity", mechanism.gravity, "acceleration")
    adaptive = simulation.adaptive is not None and settings.step is None
    step = "shortest time step" if adaptive else "time step"
    yield Assumption(GENERAL, step, settings.step or simulation.step, time, "simulation.step")
    horizon = settings.horizon or simulation.horizon
    yield Assumption(GENERAL, "longest simulated time", horizon, time, "simulation.horizon")
    numbers = dict(_leaves(mechanism, "")) | settings.values()
    for key, name in _SETTINGS.items():
        if key in numbers and (adaptive or "adaptive" not in key):
            yield _number(mechanism, GENERAL, name, numbers[key], key)
    if simulation.scheme != "combined":
        yield Assumption(GENERAL, "scheme", simulation.scheme, "", "simulation.scheme")
    for condition in mechanism.validity:
        yield Assumption(GENERAL, "a run is valid only if", str(condition), "", "validity")
    yield Assumption(GENERAL, "build of the engine", plan.engine_build[:16], "", "")


def _contact_laws(mechanism: Mechanism) -> Iterator[Assumption]:
    """Yield friction and restitution of each pair of materials, then of joints and contacts with their own values.

    Friction of ideal joints is a force or torque.
    """
    contacts = {f"contacts.{n}": c for n, c in mechanism.contacts.items()}
    pairs: dict[str, Any] = {f"joints.{n}": p for n, p in mechanism.joints.items() if not p.ideal} | contacts
    of_materials = {name: material.between for name, material in mechanism.materials.items()}
    users = defaultdict(list)  # joints and contacts by the pair of materials whose law applies; None without one
    for key, pair in pairs.items():
        law = pair.material or pair_between([mechanism.bodies[side.body].material for side in pair.sides], of_materials)
        users[law].append(key.partition(".")[2])
    for name, material in mechanism.materials.items():
        where = f" ({_listed(users[name])})" if users[name] else " (not used)"
        for law in ("friction", "friction_across", "static_friction", "restitution"):
            if getattr(material, law) is not None:
                key = f"materials.{name}.{law}"
                yield Assumption(CONTACT, f"{_in_words(law)} of {name}{where}", getattr(material, law), "1", key)
    if users[None]:
        where = _listed(users[None])
        yield Assumption(CONTACT, f"friction and restitution without a material ({where})", 0.0, "1", "")
    for key, pair in pairs.items():
        for law in ("friction", "friction_across", "static_friction", "restitution"):
            if getattr(pair, law, None) is not None:
                name = f"{_in_words(law)} of {key.partition('.')[2]}, instead of its material's"
                yield Assumption(CONTACT, name, getattr(pair, law), "1", f"{key}.{law}")
    limits = {f"joints.{n}.limits": getattr(j, "limits", None) for n, j in mechanism.joints.items()}
    ideal = {f"joints.{n}": j for n, j in mechanism.joints.items() if j.ideal}
    gears = {f"couplings.{n}": pair for n, pair in mechanism.couplings.items()}
    materials = {f"materials.{n}": material for n, material in mechanism.materials.items()}
    pressed = contacts | limits | gears, ("stiffness", "hertz_stiffness", "damping")
    turning = materials | contacts, ("rolling_friction", "spinning_friction")
    for key, slides in (materials | contacts).items():
        if (table := slides.friction_over_speed) is not None:
            name = f"friction over speed of {key.partition('.')[2]}"
            yield from _entries(mechanism, table, CONTACT, name, f"{key}.friction_over_speed")
    for owners, fields in (pressed, turning, (ideal, _RUBBING)):
        for key, owner in owners.items():
            for field in fields:
                if (number := getattr(owner, field, None)) is not None:
                    name = f"{_in_words(field)} of {key.partition('.')[2]}"
                    yield _number(mechanism, CONTACT, name, number, f"{key}.{field}")


def _listed(names: list[str]) -> str:
    """Return names as text; if there are many, the first ones and the number of the others."""
    shown, more = names[:_NAMES_SHOWN], len(names) - _NAMES_SHOWN
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def _plays(mechanism: Mechanism) -> Iterator[Assumption]:
    """Yield the clearances of joints, the backlash of couplings and the offsets of contacts."""
    for name, joint in mechanism.joints.items():
        for field, number in () if joint.ideal else joint.entries().items():
            if field.endswith("clearance") and isinstance(number, float):
                yield _number(mechanism, PLAY, f"{_in_words(field)} of {name}", number, f"joints.{name}.{field}")
    for name, coupling in mechanism.couplings.items():
        yield _number(mechanism, PLAY, f"backlash of {name}", coupling.backlash, f"couplings.{name}.backlash")
    for name, contact in mechanism.contacts.items():
        if contact.offset:
            key = f"contacts.{name}.offset"
            yield Assumption(PLAY, f"offset of contact {name}", contact.offset, mechanism.unit("length"), key)


def _entries(mechanism: Mechanism, table: TableModel, group: str, owner: str, key: str) -> Iterator[Assumption]:
    """Yield the numbers and vectors of a table and of the tables in it.

    Points of action are left out, and zeros that are the default.
    """
    for field, value in table.entries().items():
        info = field_of(type(table), field)
        quantity = declared(info, Quantity)
        name, path = f"{_in_words(field)} of {owner}", f"{key}.{field}"
        if isinstance(value, TableModel):
            yield from _entries(mechanism, value, group, name if field != "law" else f"the law of {owner}", path)
        elif isinstance(value, float) and (value or info is None or info.is_required()):
            yield _number(mechanism, group, name, value, path)
        elif field == "table":
            yield Assumption(group, f"points of {owner}", f"{len(value)} points", "", path)
        elif _is_vector(value) and quantity and quantity.name != "length":
            yield _vector(mechanism, group, name, path, value, quantity.name)


def _masses(mechanism: Mechanism) -> Iterator[Assumption]:
    for name, body in mechanism.bodies.items():
        if body.fixed:
            continue
        yield Assumption(MASSES, f"mass of {name}", body.mass or 0.0, mechanism.unit("mass"), f"bodies.{name}.mass")
        for field, quantity in (("velocity", "speed"), ("angular_velocity", "angular speed")):
            if any(getattr(body, field)):
                words, key = f"{_in_words(field)} of {name} at the start", f"bodies.{name}.{field}"
                yield _vector(mechanism, MASSES, words, key, getattr(body, field), quantity)


def _number(mechanism: Mechanism, group: str, name: str, value: float, key: str) -> Assumption:
    return Assumption(group, name, value, unit_of(mechanism, key), key)


def _vector(mechanism: Mechanism, group: str, name: str, key: str, value: Any, quantity: str) -> Assumption:
    return Assumption(group, name, tuple(value), mechanism.unit(quantity), key)


def _is_vector(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) == 3 and all(isinstance(x, float) for x in value)


def _in_words(field: str) -> str:
    return field.replace("_", " ").strip()
