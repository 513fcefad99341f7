"""Checks at the start pose: parts must not overlap, and ideal joints must be closed."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from engine.assembly.bilateral import BilateralRow, bilateral_arrays, turning_arm
from engine.errors import MechanismError
from engine.kernels.bilateral import row_violations
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.model import SLIDE, TURN, Contacts, Scratch, State
from engine.mechanism.keys.values import get_value
from engine.mechanism.models import Mechanism

JOINT_TOLERANCE = 1e-5  # largest violation of an ideal joint at the start, in arms of its bodies (and so in rad)


def refuse_long_step(mechanism: Mechanism) -> None:
    """Raise MechanismError if the step exceeds the horizon, so that not one whole step would be made."""
    sim, unit = mechanism.simulation, mechanism.unit("time")
    if sim.step > sim.horizon:
        raise MechanismError(
            f"{mechanism.name}: simulation.step = {sim.step:g} {unit}: longer than simulation.horizon = "
            f"{sim.horizon:g} {unit}; allowed: a step no longer than the horizon, of which it is a small part; "
            "shorten the step"
        )


def refuse_overlap(mechanism: Mechanism, contacts: Contacts, names: Sequence[str], state: State, work: Scratch) -> None:
    """Write the gaps at the start into the state.

    Raise MechanismError if a gap is below minus the allowed penetration: one line for each contact, or clearance or
    limit of a joint.
    """
    gap = state.gap
    find_contacts(contacts, state.x, state.R, gap, work.sites.point, work.sites.frame)
    if (gap >= -mechanism.simulation.penetration).all():
        return
    worst: dict[str, int] = {}  # faces of a joint with the same clearance share one fault
    for i, name in enumerate(names):
        if not gap[i] >= -mechanism.simulation.penetration:
            key = _clearance_key(mechanism, name)
            worst[key] = i if key not in worst or gap[i] < gap[worst[key]] else worst[key]
    if worst:
        lines = [_overlap(mechanism, key, names[i], float(gap[i])) for key, i in worst.items()]
        raise MechanismError("\n  ".join([f"{mechanism.name}: parts overlap at the start pose", *lines]))


def _clearance_key(mechanism: Mechanism, name: str) -> str:
    """Return the key of the clearance at a contact of a joint, or the key of another contact."""
    joint, _, face = name.partition(".")
    if face and mechanism.joints[joint].ideal:
        return f"joints.{joint}.limits.{face}"
    return f"joints.{joint}.{mechanism.joints[joint].face_clearance(face)}" if face else f"contacts.{name}"


def _overlap(mechanism: Mechanism, key: str, name: str, gap: float) -> str:
    """Return the line of a message that names the overlapping pair and the allowed values."""
    unit = mechanism.unit("length")
    if key == f"contacts.{name}":
        return f"{key}: gap {gap:.6g} {unit} at the start; allowed: >= 0; move the bodies, the features or `offset`"
    clearance = get_value(mechanism, key)
    if ".limits." in key:
        return (
            f"{key} = {clearance:.6g} {unit}: the joint is {-gap:.6g} {unit} beyond it at the start; "
            "allowed: limits on both sides of the start; widen them, or move the bodies"
        )
    return (
        f"{key} = {clearance:.6g} {unit}: {name.partition('.')[2]} is {clearance - gap:.6g} {unit} off its centred "
        f"place at the start; allowed: at least {clearance - gap:.6g} {unit}, or move the bodies"
    )


def refuse_open_joints(mechanism: Mechanism, held: list[BilateralRow], state: State) -> None:
    """Raise MechanismError if an ideal joint is open at the start, with one line for each fault.

    A joint is open if its points are apart along a direction that it holds, or its axes are inclined (an angle times
    the arm), by more than 1e-5 of the arm and more than `simulation.penetration`.
    """
    if not held:
        return
    rows, n = bilateral_arrays(held), len(held)
    violation = np.zeros(n)
    row_violations(rows, state.x, state.R, np.zeros(n), violation, np.zeros((n, 3)), np.zeros((n, 3)))
    joints = np.array([row.name.partition(".")[0] for row in held])
    faults: list[str] = []
    for joint in dict.fromkeys(joints.tolist()):
        slides, turns = (joints == joint) & (rows.kind == SLIDE), (joints == joint) & (rows.kind == TURN)
        faults += _open(mechanism, joint, np.linalg.norm(violation[slides]), np.linalg.norm(violation[turns]))
    if faults:
        raise MechanismError("\n  ".join([f"{mechanism.name}: joints are open at the start pose", *faults]))


def _open(mechanism: Mechanism, name: str, apart: Any, inclined: Any) -> Iterator[str]:
    """Yield a line if a joint's points are too far apart or its axes too inclined [both given as lengths]."""
    joint, unit = mechanism.joints[name], mechanism.unit("length")
    arm = turning_arm(mechanism, [side.body for side in joint.sides])
    allowed = max(mechanism.simulation.penetration, JOINT_TOLERANCE * arm)
    sides = " and ".join(joint.SIDES)
    if not apart <= allowed:
        yield (
            f"joints.{name}: the points of {sides} are {apart:.6g} {unit} apart along what the joint holds; "
            f"allowed: up to {allowed:.3g} {unit}; move a body, or correct one of the two points; "
            "where they vary, let one parameter give both"
        )
    if not inclined <= allowed:
        yield (
            f"joints.{name}: the axes of {sides} are {inclined / arm:.6g} rad apart; "
            f"allowed: up to {allowed / arm:.3g} rad; turn a body, or correct one of the two axes"
        )
