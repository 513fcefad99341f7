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
from engine.mechanism.base import TableModel
from engine.mechanism.components import declared
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
    mechanism = plan.mechanism
    varies = _varies(plan)
    found = [
        *_general(plan),
        *_parameters(mechanism),
        *_contact_laws(mechanism),
        *_plays(mechanism),
        *_loads(mechanism),
        *_masses(mechanism),
    ]
    found += _phases(mechanism)
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
        one, other = (_numbers(set_values(plan.mechanism, values)) for values in (centre, away))
    except MechanismError:  # a discrete variable, or parts that would overlap: only the keys themselves are known
        one, other = {}, {}
    changed = {key for key in one.keys() | other.keys() if one.get(key) != other.get(key)}
    changed |= {full_key(plan.mechanism, key) for key in plan.targets.values()}
    return lambda key: key in changed


def _numbers(mechanism: Mechanism) -> dict[str, float]:
    """Return every number of a mechanism by its dotted path, including the components of vectors."""
    return dict(_leaves(mechanism, ""))


def _leaves(node: Any, prefix: str) -> Iterator[tuple[str, float]]:
    """Yield the dotted path and the value of every number below a node."""
    if isinstance(node, float):
        yield prefix, node
        return
    if isinstance(node, TableModel):
        items = list(node.entries().items())
    elif isinstance(node, tuple):
        is_vector = len(node) == 3 and all(isinstance(item, float) for item in node)
        items = list(zip(_COMPONENTS, node, strict=True)) if is_vector else [(str(i), x) for i, x in enumerate(node)]
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
    """Yield the system of units, gravity, and the settings of the runs."""
    mechanism, settings = plan.mechanism, plan.spec.simulation
    yield Assumption(GENERAL, "system of units", mechanism.units, "", "units")
    if plan.spec.bench:
        yield Assumption(GENERAL, "test bench", plan.spec.bench, "", "")
    if plan.spec.preset:
        yield Assumption(GENERAL, "preset", plan.spec.preset, "", "")
    yield _vector(mechanism, GENERAL, "gravity", "gravity", mechanism.gravity, "acceleration")
    simulation = mechanism.simulation
    adaptive = simulation.adaptive is not None and settings.step is None
    step = "shortest time step" if adaptive else "time step"
    time = mechanism.unit("time")
    yield Assumption(GENERAL, step, settings.step or simulation.step, time, "simulation.step")
    yield Assumption(
        GENERAL, "longest simulated time", settings.horizon or simulation.horizon, time, "simulation.horizon"
    )
    numbers = _numbers(mechanism) | settings.values()
    for key, name in _SETTINGS.items():
        if key in numbers and (adaptive or "adaptive" not in key):
            yield Assumption(GENERAL, name, numbers[key], unit_of(mechanism, key), key)
    if simulation.scheme != "combined":
        yield Assumption(GENERAL, "scheme", simulation.scheme, "", "simulation.scheme")
    for condition in mechanism.validity:
        yield Assumption(GENERAL, "a run is valid only if", str(condition), "", "validity")
    yield Assumption(GENERAL, "build of the engine", plan.engine_build[:16], "", "")


def _parameters(mechanism: Mechanism) -> Iterator[Assumption]:
    """Yield the parameters of the file, on which other numbers depend."""
    for name, value in mechanism.parameters.items():
        key = f"parameters.{name}"
        yield Assumption(PARAMETERS, name, value, unit_of(mechanism, key), key)


def _contact_laws(mechanism: Mechanism) -> Iterator[Assumption]:
    """Yield friction and restitution of each pair of materials, then of joints and contacts with their own values.

    Friction of ideal joints is a force or torque.
    """
    pairs: dict[str, Any] = {f"joints.{n}": p for n, p in mechanism.joints.items() if not p.ideal}
    pairs |= {f"contacts.{n}": p for n, p in mechanism.contacts.items()}
    users = defaultdict(list)
    for key, pair in pairs.items():
        users[_material_of(mechanism, pair)].append(key.partition(".")[2])
    for name, material in mechanism.materials.items():
        where = f" ({_listed(users[name])})" if users[name] else " (not used)"
        for law in ("friction", "restitution"):
            key = f"materials.{name}.{law}"
            yield Assumption(CONTACT, f"{law} of {name}{where}", getattr(material, law), "1", key)
    if users[None]:
        where = _listed(users[None])
        yield Assumption(CONTACT, f"friction and restitution without a material ({where})", 0.0, "1", "")
    for key, pair in pairs.items():
        for law in ("friction", "restitution"):
            if getattr(pair, law) is not None:
                name = f"{law} of {key.partition('.')[2]}, instead of its material's"
                yield Assumption(CONTACT, name, getattr(pair, law), "1", f"{key}.{law}")
    springs: dict[str, Any] = {f"contacts.{n}": c for n, c in mechanism.contacts.items()}
    springs |= {f"joints.{n}.limits": getattr(j, "limits", None) for n, j in mechanism.joints.items()}
    for key, spring in springs.items():
        for field in ("stiffness", "damping"):
            if (number := getattr(spring, field, None)) is not None:
                where = key.partition(".")[2]
                yield Assumption(
                    CONTACT, f"{field} of {where}", number, unit_of(mechanism, f"{key}.{field}"), f"{key}.{field}"
                )
    for name, joint in mechanism.joints.items():
        for field in _RUBBING if joint.ideal else ():
            number = getattr(joint, field, None)
            if number is not None:
                key = f"joints.{name}.{field}"
                yield Assumption(CONTACT, f"{_in_words(field)} of {name}", number, unit_of(mechanism, key), key)


def _material_of(mechanism: Mechanism, pair: Any) -> str | None:
    """Return the pair of materials whose law applies to a joint or contact; None without one."""
    bodies = [mechanism.bodies[side.body].material for side in pair.sides]
    pairs = {name: material.between for name, material in mechanism.materials.items()}
    return pair.material or pair_between(bodies, pairs)


def _listed(names: list[str]) -> str:
    """Return names as text; if there are many, the first ones and the number of the others."""
    shown, more = names[:_NAMES_SHOWN], len(names) - _NAMES_SHOWN
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def _plays(mechanism: Mechanism) -> Iterator[Assumption]:
    """Yield the clearances of joints, the backlash of couplings and the offsets of contacts."""
    for name, joint in mechanism.joints.items():
        if joint.ideal:
            continue
        for field, number in joint.entries().items():
            if field.endswith("clearance") and isinstance(number, float):
                key = f"joints.{name}.{field}"
                yield Assumption(PLAY, f"{_in_words(field)} of {name}", number, unit_of(mechanism, key), key)
    for name, coupling in mechanism.couplings.items():
        key = f"couplings.{name}.backlash"
        yield Assumption(PLAY, f"backlash of {name}", coupling.backlash, unit_of(mechanism, key), key)
    for name, contact in mechanism.contacts.items():
        if contact.offset:
            key = f"contacts.{name}.offset"
            yield Assumption(PLAY, f"offset of contact {name}", contact.offset, mechanism.unit("length"), key)


def _loads(mechanism: Mechanism) -> Iterator[Assumption]:
    """Yield the numbers and vectors of springs, dampers, forces, torques and motions, except their points of action."""
    for table, kind in _LOADS.items():
        for name, load in getattr(mechanism, table).items():
            yield from _entries(mechanism, load, LOADS, f"{kind} {name}", f"{table}.{name}")


def _entries(mechanism: Mechanism, table: TableModel, group: str, owner: str, key: str) -> Iterator[Assumption]:
    """Yield the numbers and vectors of a table and of the tables in it, without zeros that are the default."""
    for field, value in table.entries().items():
        info = field_of(type(table), field)
        quantity = declared(info, Quantity)
        name, path = f"{_in_words(field)} of {owner}", f"{key}.{field}"
        if isinstance(value, TableModel):
            yield from _entries(mechanism, value, group, name if field != "law" else f"the law of {owner}", path)
        elif isinstance(value, float) and (value or info is None or info.is_required()):
            yield Assumption(group, name, value, unit_of(mechanism, path), path)
        elif field == "table":
            yield Assumption(group, f"points of {owner}", f"{len(value)} points", "", path)
        elif _is_vector(value) and quantity and quantity.name != "length":
            yield _vector(mechanism, group, name, path, value, quantity.name)


def _masses(mechanism: Mechanism) -> Iterator[Assumption]:
    """Yield the mass of every moving body, and its speeds at the start."""
    for name, body in mechanism.bodies.items():
        if body.fixed:
            continue
        yield Assumption(MASSES, f"mass of {name}", body.mass or 0.0, mechanism.unit("mass"), f"bodies.{name}.mass")
        for field, quantity in (("velocity", "speed"), ("angular_velocity", "angular speed")):
            if any(getattr(body, field)):
                words, key = f"{_in_words(field)} of {name} at the start", f"bodies.{name}.{field}"
                yield _vector(mechanism, MASSES, words, key, getattr(body, field), quantity)


def _phases(mechanism: Mechanism) -> Iterator[Assumption]:
    """Yield the durations and the drag of the phases of a run."""
    for i, phase in enumerate(mechanism.phases):
        yield from _entries(mechanism, phase, PHASES, f"phase {phase.name}", f"phases.{i}")


def _vector(mechanism: Mechanism, group: str, name: str, key: str, value: Any, quantity: str) -> Assumption:
    """Return an assumption with three components."""
    return Assumption(group, name, tuple(value), mechanism.unit(quantity), key)


def _is_vector(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) == 3 and all(isinstance(x, float) for x in value)


def _in_words(field: str) -> str:
    """Return the name of a key as words."""
    return field.replace("_", " ").strip()
