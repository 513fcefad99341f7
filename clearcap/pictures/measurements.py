"""What the responses of a mechanism measure, and where: lengths, forces, speeds and angles at the start pose."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from clearcap.pictures.view import start_rotation
from engine import Mechanism
from engine.arrays import Array


class StartContact(NamedTuple):
    """A contact at the start pose."""

    gap: float  # distance between its sides [length]
    point: Array  # in the world [length], (3,)
    normal: Array  # direction of the normal force on ``body``, (3,)
    body: str  # the first moving body of the two


@dataclass(frozen=True)
class Measurement:
    """A response to be drawn.

    The kinds are "length" from ``start`` to ``end``; "arrow", a force or speed at ``start`` towards ``end``; "turn" at
    ``start`` about the axis to ``end``; "point", a force without a single direction; "span", a spring from ``start`` to
    ``end``; "none", a response without a place.
    """

    name: str
    title: str
    kind: str
    start: Array  # start and end in the world, (3,); from one to the other is the positive direction
    end: Array
    point: Array  # the measured point, beside one end or at it, (3,)
    value: str  # of a length at the start pose with its unit; otherwise the measured quantity and its body

    @property
    def force(self) -> bool:
        """Whether it is drawn as a force."""
        return self.kind in ("arrow", "point")


def measurements(mechanism: Mechanism, contacts: dict[str, StartContact]) -> Iterator[Measurement]:
    """Yield what each response measures at the start pose, in the order of the file; see `contacts_at_start`."""
    for name, response in mechanism.responses.items():
        kind, start, end, point, value = _measured(mechanism, response, contacts)
        yield Measurement(name, response.title, kind, start, end, point, value)


def _measured(
    mechanism: Mechanism, response: Any, contacts: dict[str, StartContact]
) -> tuple[str, Array, Array, Array, str]:
    """Return kind, start, end, point and value of a response."""
    if response.type == "position":
        return _length(mechanism, response)
    if response.type == "velocity":
        body, along = response.to.body, _direction(mechanism, response.direction)
        at = _world(mechanism, body, response.to.point)
        return "arrow", at, at + along, at, f"speed of a point of {body}"
    if response.type in ("gap", "contact_force"):
        return _of_contact(mechanism, response, contacts)
    if response.type == "joint_force":
        side = mechanism.joints[response.joint].sides[1]
        at = _world(mechanism, side.body, side.point)
        if response.direction is None:
            return "point", at, at, at, f"size of the force on {side.body}"
        return "arrow", at, at + _direction(mechanism, response.direction), at, f"arrow: force on {side.body}"
    if response.type == "spring_force":
        spring: Any = mechanism.springs[response.spring]
        a, b = (_world(mechanism, end.body, end.point) for end in (spring.a, spring.b))
        return "span", a, b, b, f"force of spring {response.spring}"
    if response.type == "spring_torque":
        torsion: Any = mechanism.springs[response.spring]
        return _turn(mechanism, torsion.b, torsion.a, torsion.axis, f"torque on {torsion.b}")
    if response.type.startswith("motion_"):
        return _of_motion(mechanism, response)
    if response.type in ("angle", "angular_velocity"):
        against = response.relative_to
        what = "rotation" if response.type == "angle" else "angular velocity"
        return _turn(mechanism, response.body, against, response.axis, f"{what} of {response.body}")
    return "none", np.zeros(3), np.zeros(3), np.zeros(3), _without_place(response)


def _length(mechanism: Mechanism, response: Any) -> tuple[str, Array, Array, Array, str]:
    """Return a position along a direction, measured from a point, or from the measured point's foot on an axis."""
    start, direction = response.from_, _direction(mechanism, response.direction)
    to = _world(mechanism, response.to.body, response.to.point)
    if start.axis is None:
        begin = _world(mechanism, start.body, start.point)
    else:
        begin = _world(mechanism, start.body, start.axis.point)
        axis = start_rotation(mechanism, start.body) @ start.axis.axis
        begin = begin + (to - begin) @ axis * axis
    value = float(direction @ (to - begin)) + response.offset
    end = begin + value * direction
    first, last = (begin, end) if value >= 0 else (end, begin)
    return "length", first, last, to, _value_text(mechanism, value)


def _of_contact(
    mechanism: Mechanism, response: Any, contacts: dict[str, StartContact]
) -> tuple[str, Array, Array, Array, str]:
    """Return the gap or the force of a contact."""
    if response.contact not in contacts:
        return "none", np.zeros(3), np.zeros(3), np.zeros(3), f"contact {response.contact}"
    gap, point, normal, body = contacts[response.contact]
    if response.type == "gap":
        return "length", point, point + gap * normal, point, _value_text(mechanism, gap)
    if response.component == "friction":
        return "point", point, point, point, f"friction on {body}"
    return "arrow", point, point + normal, point, f"arrow: force on {body}"


def _turn(
    mechanism: Mechanism, body: str, against: str | None, axis: Any, value: str
) -> tuple[str, Array, Array, Array, str]:
    """Return a rotation of a body about an axis of another, at a joint between them or else at its centre of mass."""
    others = {against} if against else {name for name, each in mechanism.bodies.items() if each.fixed}
    sides = [joint.sides for joint in mechanism.joints.values()]
    between = [(a, b) for pair in sides for a, b in (pair, pair[::-1]) if a.body == body and b.body in others]
    at = _world(mechanism, body, between[0][0].point if between else mechanism.bodies[body].center_of_mass)
    turned = (start_rotation(mechanism, against) if against else np.eye(3)) @ np.asarray(axis)
    return "turn", at, at + turned, at, value


def _of_motion(mechanism: Mechanism, response: Any) -> tuple[str, Array, Array, Array, str]:
    """Return the travel, force, torque or work of a prescribed motion, at the point or axis that it leads."""
    motion: Any = mechanism.motions[response.motion]
    value = f"{response.type.removeprefix('motion_')} of motion {response.motion}"
    if "about" in type(motion).model_fields:
        return _turn(mechanism, motion.body, motion.relative_to, motion.about.axis, value)
    at, way = _world(mechanism, motion.body, motion.along.point), np.asarray(motion.along.direction)
    if motion.relative_to:
        way = start_rotation(mechanism, motion.relative_to) @ way
    return "arrow", at, at + way, at, value


def _without_place(response: Any) -> str:
    """Describe a response that has no place in the mechanism."""
    if response.type == "difference":
        return f"{response.of[0]} minus {response.of[1]}"
    if response.type == "condition":
        return f"1 if {response.condition}, else 0"
    if response.type in ("impulse", "mean"):
        return f"{response.type} of {response.response}"
    if response.type in ("bounces", "friction_work"):
        return f"{response.type.replace('_', ' ')} of contact {response.contact}"
    if response.type == "formula":
        return str(response.formula)
    return "a time" if response.type == "time" else str(response.type).replace("_", " ")


def _direction(mechanism: Mechanism, along: Any) -> Array:
    """Return a direction of a response in the world, at the start."""
    rotation = start_rotation(mechanism, along.body) if along.body else np.eye(3)
    return np.asarray(rotation @ along.vector)


def contacts_at_start(mechanism: Mechanism) -> dict[str, StartContact]:
    """Return every contact at the start pose, by name."""
    # compiled code, which other pictures do not need
    from engine.assembly import assemble
    from engine.assembly.frames import order_bodies
    from engine.kernels.contact_geometry.gaps import find_contacts

    assembly = assemble(mechanism)
    state, work, contacts = assembly.state, assembly.work, assembly.model.contacts
    find_contacts(contacts, state.x, state.R, state.gap, work.sites.point, work.sites.frame)
    order, at_start = order_bodies(mechanism), {}
    for i, name in enumerate(assembly.contact_names):
        first = contacts.a[i] < len(order)
        pushed, normal = (contacts.a[i], work.sites.frame[i, 0]) if first else (contacts.b[i], -work.sites.frame[i, 0])
        at_start[name] = StartContact(float(state.gap[i]), work.sites.point[i].copy(), normal, order[pushed])
    return at_start


def _world(mechanism: Mechanism, body: str, point: Any) -> Array:
    """Return a point of a body in the world, at the start."""
    return np.asarray(mechanism.bodies[body].origin + start_rotation(mechanism, body) @ np.array(point, float))


def _value_text(mechanism: Mechanism, value: float) -> str:
    return f"{value:.4g} {mechanism.unit('length')} here"
