"""Springs, forces and torques as arrays."""

from typing import Any

import numpy as np

from engine.assembly.frames import Array, Frame, quaternion
from engine.kernels.model import Loads
from engine.mechanism.loads import Force, Torque
from engine.mechanism.models import Mechanism


def load_arrays(mechanism: Mechanism, frames: dict[str, Frame]) -> Loads:
    """Return all loads as arrays."""
    return Loads(
        gravity=np.array(mechanism.gravity, float),
        **_springs(mechanism, frames),
        **_torsion_springs(mechanism, frames),
        **_constant_loads(mechanism, frames),
    )


def _springs(mechanism: Mechanism, frames: dict[str, Frame]) -> dict[str, Any]:
    """Return the springs between two points."""
    springs = [s for s in mechanism.springs.values() if s.type == "linear"]
    ends = [(frames[s.a.body], s.a.point, frames[s.b.body], s.b.point) for s in springs]
    return {
        "spring_body": np.array([(a.index, b.index) for a, _, b, _ in ends], np.int64).reshape(-1, 2),
        "spring_point": np.array([(*a.point(p), *b.point(q)) for a, p, b, q in ends], float).reshape(-1, 6),
        "spring_law": np.array([(s.stiffness, s.free_length, s.damping) for s in springs], float).reshape(-1, 3),
    }


def _torsion_springs(mechanism: Mechanism, frames: dict[str, Frame]) -> dict[str, Any]:
    """Return the torsion springs; the angle at the start picks the branch of the angle."""
    springs = [s for s in mechanism.springs.values() if s.type == "torsion"]
    ends = [(frames[s.a], frames[s.b]) for s in springs]
    axes = [np.asarray(s.axis, float) / np.linalg.norm(s.axis) for s in springs]
    law = [
        (s.stiffness, s.free_angle - s.preload, s.damping, _start_angle(mechanism, s, axis))
        for s, axis in zip(springs, axes, strict=True)
    ]
    return {
        "torsion_body": np.array([(a.index, b.index) for a, b in ends], np.int64).reshape(-1, 2),
        "torsion_frame": np.array([(a.quaternion, b.quaternion) for a, b in ends], float).reshape(-1, 2, 4),
        "torsion_axis": np.array(axes, float).reshape(-1, 3),
        "torsion_law": np.array(law, float).reshape(-1, 4),
    }


def _start_angle(mechanism: Mechanism, spring: Any, axis: Array) -> float:
    """Angle of body b's frame about the spring's axis, from body a's, as the file places them."""
    a, b = mechanism.bodies[spring.a], mechanism.bodies[spring.b]
    qa, qb = quaternion(a.axis, a.angle), quaternion(b.axis, b.angle)
    vector = qa[0] * qb[1:] - qb[0] * qa[1:] - np.cross(qa[1:], qb[1:])
    return float(2 * np.arctan2(vector @ axis, qa @ qb))


def _constant_loads(mechanism: Mechanism, frames: dict[str, Frame]) -> dict[str, Any]:
    """Return constant forces (with their points) and torques, each with the phases in which it acts."""
    phases = [p.name for p in mechanism.phases]
    body, vector, in_body, active = [], [], [], []
    loads: list[Force | Torque] = [*mechanism.forces.values(), *mechanism.torques.values()]
    for load in loads:
        frame = frames[load.body]
        turn = frame.rotation if load.frame == "body" else np.eye(3)
        body.append(frame.index)
        if isinstance(load, Force):
            vector.append([*frame.point(load.point), *(turn @ load.force), *np.zeros(3)])
        else:
            vector.append([*np.zeros(6), *(turn @ load.torque)])
        in_body.append(load.frame == "body")
        active.append([load.phases is None or name in load.phases for name in phases])
    return {
        "force_body": np.array(body, np.int64),
        "force_vector": np.array(vector, float).reshape(-1, 9),
        "force_in_body": np.array(in_body, bool),
        "force_phase": np.array(active, bool).reshape(-1, len(phases)),
    }
