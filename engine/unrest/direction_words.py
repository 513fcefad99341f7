"""Directions and axes in words: world axes, axes of the body's joints, otherwise components."""

from collections.abc import Iterator

import numpy as np

from engine.arrays import Array
from engine.mechanism import Mechanism
from engine.mechanism.joints import Joint

HINGED = 0.3  # share of a body's motion that a joint with play allows at its axis
PARALLEL = 0.99  # cosine of 8 degrees, because a body in a joint with play tilts


def direction_words(mechanism: Mechanism, body: str, rotation: Array, direction: Array, signed: bool = True) -> str:
    """Return a direction in words, such as ``"-z, the axis of J1"``.

    `rotation` (3, 3) turns the axes of the body, whose joints are considered, into the world's; `direction` (3,) is in
    world axes, of any length. An axis, whose sign is irrelevant, is not `signed`.
    """
    unit = direction / np.linalg.norm(direction)
    largest = int(np.abs(unit).argmax())
    joints = [name for name, _, axis in joint_lines(mechanism, body, rotation) if abs(axis @ unit) > PARALLEL]
    named = f"the axis of {' and '.join(joints)}" if joints else ""
    if abs(unit[largest]) > PARALLEL:
        sign = ("-" if unit[largest] < 0 else "+") if signed else ""
        return ", ".join(filter(None, (f"{sign}{'xyz'[largest]}", named)))
    unit = unit if signed or unit[largest] > 0.0 else -unit
    components = ", ".join(f"{round(float(x), 3) + 0.0:g}" for x in unit)
    return named or f"({components})"


def motion_words(mechanism: Mechanism, body: str, rotation: Array, velocity: Array, spin: Array) -> str:
    """Return a description of a body's motion to and fro: along a direction, about an axis, or both.

    `rotation` (3, 3) turns the body's axes into the world's; `velocity` of the centre of mass and `spin`, both (3,),
    are in world axes, of any magnitude.
    """
    about = f"about {direction_words(mechanism, body, rotation, spin, signed=False)}" if spin.any() else ""
    hinged = any(
        np.linalg.norm(velocity + np.cross(spin, point)) < HINGED * np.linalg.norm(velocity)
        for _, point, _ in joint_lines(mechanism, body, rotation)
    )
    if about and (hinged or not velocity.any()):
        return about
    along = f"along {direction_words(mechanism, body, rotation, velocity, signed=False)}"
    return f"{along} and {about}" if about else along


def joint_lines(mechanism: Mechanism, body: str, rotation: Array) -> Iterator[tuple[str, Array, Array]]:
    """Yield the joints of a body that have an axis: name, point from the centre of mass, unit axis; in world axes."""
    centre = np.array(mechanism.bodies[body].center_of_mass)
    for name, joint in mechanism.joints.items():
        for side, axis in _own_lines(joint, body):
            vector = np.array(axis, float)
            yield name, rotation @ (np.array(side) - centre), rotation @ (vector / np.linalg.norm(vector))


def _own_lines(joint: Joint, body: str) -> Iterator[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Yield point and axis of a joint on a body."""
    for side, axis in zip(joint.sides, joint.axes or (), strict=False):
        if side.body == body:
            yield side.point, axis
            return
