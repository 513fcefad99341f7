"""Responses as arrays; their geometry rows are described in `kernels.responses`."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.assembly.contacts import Pair
from engine.assembly.frames import BodyFrame
from engine.assembly.loads import event_limit
from engine.errors import Fault, MechanismError
from engine.kernels import model
from engine.kernels.model import Responses, State
from engine.mechanism.bushings import Yielding
from engine.mechanism.faults import did_you_mean
from engine.mechanism.models import Mechanism
from engine.mechanism.responses import JointTorque, Peak

ORIGIN = (0.0, 0.0, 0.0)
KINDS = {
    "position": model.POSITION,
    "velocity": model.VELOCITY,
    "angle": model.ANGLE,
    "angular_velocity": model.ANGULAR_VELOCITY,
    "gap": model.GAP,
    "contact_impulse": model.CONTACT_IMPULSE,
    "contact_force": model.CONTACT_FORCE,
    "joint_force": model.JOINT_FORCE,
    "joint_torque": model.BUSHING_TORQUE,
    "spring_force": model.SPRING_FORCE,
    "spring_torque": model.SPRING_TORQUE,
    "motion_travel": model.MOTION_TRAVEL,
    "motion_work": model.MOTION_WORK,
    "motion_force": model.MOTION_FORCE,
    "motion_torque": model.MOTION_FORCE,
    "impulse": model.IMPULSE,
    "mean": model.MEAN,
    "bounces": model.BOUNCES,
    "friction_work": model.FRICTION_WORK,
    "time": model.TIME,
    "difference": model.DERIVED,
    "condition": model.DERIVED,
    "formula": model.DERIVED,
}
MOTION = ("position", "angle", "gap", "motion_travel")


def reads_motions(mechanism: Mechanism) -> bool:
    """Return whether a response reads the force or the work of a prescribed motion."""
    kinds = [KINDS[response.type] for response in mechanism.responses.values()]
    return model.MOTION_WORK in kinds or model.MOTION_FORCE in kinds


def response_arrays(
    mechanism: Mechanism, frames: dict[str, BodyFrame], state: State, pairs: list[Pair], rows: list[str]
) -> Responses:
    """Return the responses: what is measured, and when it is reported.

    ``pairs`` are all contacts, and ``rows`` the names of all bilateral rows.

    Raise MechanismError if a response names a contact that its joint does not have, or the force of a joint without
    contacts.
    """
    items = mechanism.responses.items()
    _refuse_missing_contacts(mechanism, [*(pair.name for pair in pairs), *mechanism.contacts])
    what = [_measured(mechanism, response, frames, state, pairs, rows) for _, response in items]
    when = [_reported(mechanism, response) for _, response in items]
    return Responses(
        kind=np.array([kind for kind, _, _ in what], np.int64),
        body=np.array([body for _, body, _ in what], np.int64).reshape(-1, 3),
        point=np.array([point for _, _, point in what], float).reshape(-1, 12),
        offset=np.array([getattr(response, "offset", 0.0) for _, response in items], float),
        averaged_over=np.array([getattr(r, "averaged_over", None) or 0.0 for _, r in items], float),
        window=np.array([getattr(r, "window", None) or (0.0, np.inf) for _, r in items], float).reshape(-1, 2),
        measures_motion=np.array([r.type in MOTION and r.at == "end" for _, r in items], bool),  # in every phase
        at=np.array([at for at, _, _ in when], np.int64),
        from_phase=np.array([_phase(mechanism, r.from_phase, 0) for _, r in items], np.int64),
        to_phase=np.array([_phase(mechanism, r.to_phase, -1) for _, r in items], np.int64),
        trigger=np.array([i if trigger is None else trigger for i, (_, trigger, _) in enumerate(when)], np.int64),
        limit=np.array([limit for _, _, limit in when], float).reshape(-1, 2),
    )


def _measured(
    mechanism: Mechanism, response: Any, frames: dict[str, BodyFrame], state: State, pairs: list[Pair], rows: list[str]
) -> tuple[int, tuple[int, int, int], Array]:
    """Return the kind, the bodies (or contacts, spring, or row) and the geometry of a response."""
    kind, body, point = KINDS[response.type], (0, 0, 0), np.zeros(12)
    yielding = [name for name, joint in mechanism.joints.items() if isinstance(joint, Yielding)]
    if response.type in ("position", "velocity"):
        body = _way(response, frames, point)
    elif response.type in ("angle", "angular_velocity"):
        body = _turning(response, frames, state, point)
    elif response.type in ("spring_force", "spring_torque"):
        alike = [name for name, s in mechanism.springs.items() if s.type == mechanism.springs[response.spring].type]
        body = (alike.index(response.spring), 0, 0)
    elif response.type.startswith("motion_"):
        body = (rows.index(response.motion), 0, 0)
    elif response.type in ("impulse", "mean"):
        body = (list(mechanism.responses).index(response.response), 0, 0)
    elif response.type in ("joint_force", "joint_torque") and response.joint in yielding:
        way = response.direction
        turned = frames[(way and way.body) or "world"]
        kind = model.BUSHING_FORCE if response.type == "joint_force" else model.BUSHING_TORQUE
        body, point[9:12] = (yielding.index(response.joint), 0, turned.index), ORIGIN
        if way is not None:
            point[9:12] = turned.direction(way.vector)
    elif response.type == "joint_force":
        body = _joint(mechanism, response, frames, pairs, point)
    elif kind not in (model.TIME, model.DERIVED):
        own = numbers_of([pair.name for pair in pairs], response.contact)
        body = (own[0], len(own), 0)
        rubs = pairs[body[0]].kind == model.JOINT_FRICTION  # what it has of a normal force is no force of the joint
        if response.type == "bounces":
            point[0] = mechanism.simulation.penetration if response.opening is None else response.opening
        if response.type == "contact_force" and response.bound is not None:
            kind = model.DERIVED
        elif response.type == "contact_force" and (response.component == "friction" or rubs):
            kind = model.FRICTION_FORCE
    return kind, body, point


def numbers_of(names: Sequence[str], contact: str) -> list[int]:
    """Return the numbers of a contact in a run, consecutive: one, or if it is one of two profiles, several."""
    return [i for i, name in enumerate(names) if name == contact or name.startswith(f"{contact}.")]


def coordinate_arrays(
    mechanism: Mechanism, names: list[str], frames: dict[str, BodyFrame], state: State
) -> dict[str, Any]:
    """Return the positions, angles and speeds that laws of loads depend on: those of the responses ``names``."""
    rows = [_measured(mechanism, mechanism.responses[name], frames, state, [], []) for name in names]
    return {
        "over_kind": np.array([kind for kind, _, _ in rows], np.int64),
        "over_body": np.array([body for _, body, _ in rows], np.int64).reshape(-1, 3),
        "over_point": np.array([point for _, _, point in rows], float).reshape(-1, 12),
        "over_offset": np.array([getattr(mechanism.responses[name], "offset", 0.0) for name in names], float),
        "over_value": np.zeros(len(names)),
    }


def _way(response: Any, frames: dict[str, BodyFrame], point: Array) -> tuple[int, int, int]:
    """Write the two points and the direction of a position or velocity; return their three bodies."""
    start, way = response.from_, response.direction
    a, b, turned = frames[start.body if start else "world"], frames[response.to.body], frames[way.body or "world"]
    if start is not None and start.axis is not None:
        point[0:3], point[3:6] = a.point(start.axis.point), a.direction(start.axis.axis)
    else:
        point[0:3] = a.point((start and start.point) or ORIGIN)
    point[6:9], point[9:12] = b.point(response.to.point), turned.direction(way.vector)
    return a.index, b.index, turned.index


def _turning(response: Any, frames: dict[str, BodyFrame], state: State, point: Array) -> tuple[int, int, int]:
    """Write a rotation's axis, and conj(p_b) p_a at the start, so that the angle is 0 there; return the bodies."""
    a, b = frames[response.relative_to or "world"], frames[response.body]
    p, q = state.p[b.index], state.p[a.index]
    point[3:6] = a.direction(response.axis)
    point[6] = p @ q
    point[7:10] = p[0] * q[1:] - q[0] * p[1:] - np.cross(p[1:], q[1:])
    return a.index, b.index, 0


def _joint(
    mechanism: Mechanism, response: Any, frames: dict[str, BodyFrame], pairs: list[Pair], point: Array
) -> tuple[int, int, int]:
    """Write the sign of impulses on the joint's second side, and the direction; return the contacts and the body."""
    own = [i for i, pair in enumerate(pairs) if pair.name.startswith(f"{response.joint}.")]
    second = frames[mechanism.joints[response.joint].sides[1].body]
    way = response.direction
    turned = frames[(way and way.body) or "world"]
    point[0] = 1.0 if pairs[own[0]].a == second.index else -1.0  # an impulse pushes side a along +N, and b along -N
    point[9:12] = turned.direction(way.vector) if way else ORIGIN
    return own[0], len(own), turned.index


def _reported(mechanism: Mechanism, response: Any) -> tuple[int, int | None, tuple[float, float]]:
    """Return when a response is reported: kind of instant, watched response (None: itself), limit and side."""
    at = response.at
    if isinstance(at, str):
        return (model.END if at == "end" else model.PEAK), None, (0.0, -1.0 if at == "minimum" else 1.0)
    watched = list(mechanism.responses).index(at.response)
    if isinstance(at, Peak):
        return model.PEAK, watched, (0.0, -1.0 if at.peak == "minimum" else 1.0)
    return model.EVENT, watched, event_limit(at)


def _phase(mechanism: Mechanism, name: str | None, default: int) -> int:
    """Return the number of a phase."""
    phases = [phase.name for phase in mechanism.phases]
    return phases.index(phases[default] if name is None else name)


def _refuse_missing_contacts(mechanism: Mechanism, contacts: list[str]) -> None:
    """Raise an error if a response reads a contact that a joint does not have."""
    faults = []
    for name, response in mechanism.responses.items():
        contact, joint = getattr(response, "contact", None), getattr(response, "joint", None)
        if contact is not None and contact not in contacts:
            own = [c for c in contacts if c.startswith(f"{contact.partition('.')[0]}.")]
            names = ", ".join(own) or "it has none, as an ideal joint"
            text = f"no such contact of the joint; allowed: {names}{did_you_mean(contact, own)}"
            faults.append(Fault(("responses", name, "contact"), text, contact))
        elif isinstance(response, JointTorque) and not isinstance(mechanism.joints[response.joint], Yielding):
            text = "the torque of a joint that holds by contacts or exactly; allowed: of a bushing or beam; remove it, "
            text += "or make the joint a bushing"
            faults.append(Fault(("responses", name, "joint"), text, joint))
        elif (
            joint is not None
            and not isinstance(mechanism.joints[joint], Yielding)
            and (mechanism.joints[joint].ideal or not any(c.startswith(f"{joint}.") for c in contacts))
        ):
            text = "the joint has no contacts; allowed: joints with clearance, bushings and beams; give it clearance, "
            text += "or remove the response"
            faults.append(Fault(("responses", name, "joint"), text, joint))
    if faults:
        lines = "\n".join(f"  {fault}" for fault in faults)
        raise MechanismError(f"{mechanism.name}: responses that cannot be read\n{lines}", faults)
