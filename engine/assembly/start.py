"""The start pose: no parts may overlap and ideal joints must be closed, as drawn or after the assembly step.

The step moves the bodies to the nearest pose where that is so, see `engine.assembly.nearest_start`.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.assembly.bilateral import BilateralRow, bilateral_arrays, turning_arm
from engine.assembly.frames import order_bodies
from engine.assembly.nearest_start import find_nearest_start
from engine.errors import MechanismError, NotAssemblable
from engine.kernels.bilateral import row_violations
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.model import SLIDE, TURN, Model, RunArrays, State
from engine.mechanism.contacts import SEVERAL
from engine.mechanism.couplings import GearPair
from engine.mechanism.keys.values import get_value
from engine.mechanism.models import Mechanism

JOINT_TOLERANCE = 1e-5  # largest violation of an ideal joint at the start, in arms of its bodies (and so in rad)
EXTENT = 0.01  # share of a mechanism's extent by which a body may move in the assembly step, if the file does not say
MOST_NAMED = 3  # pairs, and contacts of each, that a message names


def refuse_long_step(mechanism: Mechanism) -> None:
    """Raise MechanismError if the step exceeds the horizon, so that not one whole step would be made."""
    sim, unit = mechanism.simulation, mechanism.unit("time")
    if sim.step > sim.horizon:
        raise MechanismError(
            f"{mechanism.name}: simulation.step = {sim.step:g} {unit}: longer than simulation.horizon = "
            f"{sim.horizon:g} {unit}; allowed: a step no longer than the horizon, of which it is a small part; "
            "shorten the step"
        )


def free_start(mechanism: Mechanism, held: list[BilateralRow], names: Sequence[str], arrays: RunArrays) -> float:
    """Write the gaps at the start into the state, and move the bodies if parts overlap there or ideal joints are open.

    Return how far the body that moves farthest is from its drawn place, the root mean square over its mass; 0 if the
    drawn pose is free. Raise NotAssemblable if no body may move or no free pose is near, with one line for each
    contact, clearance, limit or joint that is at fault in the drawn pose.
    """
    drawn = _faults(mechanism, held, names, arrays)
    if not drawn:
        return 0.0
    sim, unit = mechanism.simulation, mechanism.unit("length")
    longest = EXTENT * _extent(arrays) if sim.assembly_travel is None else sim.assembly_travel
    if longest == 0.0 or not np.isfinite(longest) or not len(arrays.model.bodies.mass):
        raise NotAssemblable("\n  ".join(drawn), "; ".join(drawn[1:]))
    violation = _allowed_violations(mechanism, arrays.model, held)
    found = find_nearest_start(arrays, longest, 0.5 * sim.penetration, violation)
    stated = f"simulation.assembly_travel = {longest:.4g} {unit}"
    stated += " (if absent, 1 % of the mechanism's extent)" if sim.assembly_travel is None else ""
    left = _faults(mechanism, held, names, arrays)
    if not left and found.travel <= longest:
        return found.travel
    if not left:
        moved = order_bodies(mechanism)[found.body]
        reason = f"the nearest pose without overlap moves {moved} by {found.travel:.4g} {unit}; allowed: {stated}"
    else:
        pairs = _pairs(mechanism, [names[i] for i in found.blocking]) or _cannot_close(mechanism, held, arrays.state)
        proof = "no pose" if found.least > longest else "no pose was found that"
        reason = f"{pairs}: {proof} within {stated} frees all parts"
    raise NotAssemblable("\n  ".join([*drawn, reason]), reason)


def _faults(mechanism: Mechanism, held: list[BilateralRow], names: Sequence[str], arrays: RunArrays) -> list[str]:
    """Write the gaps into the state; return a heading, and a line for each overlap and open joint; empty: free."""
    overlaps = [*_overlaps(mechanism, names, arrays)]
    open_joints = [line for _, line in _open_joints(mechanism, held, arrays.state)]
    if not overlaps and not open_joints:
        return []
    words = ["parts overlap"] * bool(overlaps) + ["joints are open"] * bool(open_joints)
    return [f"{mechanism.name}: {' and '.join(words)} at the start pose", *open_joints, *overlaps]


def _extent(arrays: RunArrays) -> float:
    """Return twice the distance of the farthest centre of mass, contact or radius of gyration from their middle."""
    bodies = arrays.model.bodies
    points = np.concatenate([arrays.state.x[:-1], arrays.work.sites.point])
    size = np.sqrt(np.trace(bodies.inertia, axis1=1, axis2=2) / (2.0 * bodies.mass))
    far = np.linalg.norm(points - points.mean(axis=0), axis=1)
    return 2.0 * float(max(far.max(initial=0.0), size.max(initial=0.0)))


def _allowed_violations(mechanism: Mechanism, model: Model, held: list[BilateralRow]) -> Array:
    """Return what each row of joints and motions may be off; more where closed loops may hold something twice."""
    allowed = np.full(len(model.bilateral.kind), 0.5 * mechanism.simulation.joint_violation)
    if model.bilateral.closed[0]:
        allowed[: len(held)] = [_allowed(mechanism, row.name.partition(".")[0]) for row in held]
    return allowed


def _pairs(mechanism: Mechanism, contacts: Sequence[str]) -> str:
    """Return the pairs of bodies that are in the way, the strongest first, with the contacts and joints in question."""
    found: dict[str, list[str]] = {}
    for contact in contacts:
        owner, bodies = bodies_of_contact(mechanism, contact)
        known = found.setdefault(" and ".join(bodies), [])
        known += [owner] if owner not in known else []
    pairs = [f"{pair} ({_first(owners)})" for pair, owners in found.items()]
    return f"{_first(pairs)} {'are' if len(pairs) > 1 else 'is'} in the way" if pairs else ""


def _first(names: list[str]) -> str:
    """Return the first few names, and the number of the others."""
    more = len(names) - MOST_NAMED
    return ", ".join([*names[:MOST_NAMED], *([f"{more} more"] if more > 0 else [])])


def bodies_of_contact(mechanism: Mechanism, contact: str) -> tuple[str, list[str]]:
    """Return the key of the contact, or of the joint or coupling that it belongs to, and its bodies."""
    contact = contact.partition("~")[0]
    joint = contact.rpartition(".")[0]
    own = joint if joint in mechanism.contacts else contact  # of two profiles it has several points
    if own in mechanism.contacts:
        return f"contacts.{own}", [side.body for side in mechanism.contacts[own].sides]
    if joint in mechanism.couplings:
        coupling = mechanism.couplings[joint]
        if isinstance(coupling, GearPair):
            moved = [gear.body for gear in coupling.gears]
        else:
            moved = [mechanism.joints[term.joint].sides[1].body for term in coupling.terms]
        return f"couplings.{joint}", list(dict.fromkeys(moved))
    return f"joints.{joint}", [side.body for side in mechanism.joints[joint].sides]


def _overlaps(mechanism: Mechanism, names: Sequence[str], arrays: RunArrays) -> Iterator[str]:
    """Write the gaps into the state; yield a line for each contact, or clearance or limit of a joint, that overlaps."""
    contacts, state, sites = arrays.model.contacts, arrays.state, arrays.work.sites
    gap, allowed = state.gap, mechanism.simulation.penetration
    find_contacts(contacts, state.x, state.R, gap, sites.point, sites.frame)
    rigid = contacts.stiffness == 0.0  # where the others overlap, they press
    if (gap >= -allowed)[rigid].all():
        return
    worst: dict[str, int] = {}  # faces of a joint with the same clearance share one fault
    for i, name in enumerate(names):
        if rigid[i] and not gap[i] >= -allowed:
            key = _clearance_key(mechanism, name)
            worst[key] = i if key not in worst or gap[i] < gap[worst[key]] else worst[key]
    for key, i in worst.items():
        yield _overlap(mechanism, key, names[i], float(gap[i]))


def _clearance_key(mechanism: Mechanism, name: str) -> str:
    """Return the key of the clearance at a contact of a joint, or the key of another contact."""
    joint, _, face = name.partition(".")
    if joint in mechanism.contacts:
        return f"contacts.{joint}"
    if joint in mechanism.couplings:
        return f"couplings.{joint}.backlash"
    if face and mechanism.joints[joint].ideal:
        return f"joints.{joint}.limits.{face}"
    return f"joints.{joint}.{mechanism.joints[joint].face_clearance(face)}"


def _overlap(mechanism: Mechanism, key: str, name: str, gap: float) -> str:
    """Return the line of a message that names the overlapping pair and the allowed values."""
    unit = mechanism.unit("length")
    if key.startswith("contacts."):
        text = f"{key}: gap {gap:.6g} {unit} at the start; allowed: >= 0; move the bodies, the features or `offset`"
        rigid = mechanism.contacts[key.partition(".")[2]].kind in SEVERAL  # in any case
        return text if rigid else f"{text}; parts that press each other need a `stiffness`"
    owner, bodies = bodies_of_contact(mechanism, name)
    joint, _, face = name.partition(".")
    if joint in mechanism.couplings:
        return (
            f"{key} = {get_value(mechanism, key):.6g} {unit}: the teeth of {' and '.join(bodies)} overlap by "
            f"{-gap:.6g} {unit} at the start; allowed: >= 0; move their axes apart, or give more backlash"
        )
    clearance = get_value(mechanism, key) if mechanism.joints[joint].ideal else mechanism.joints[joint].play(face)
    if any(mechanism.stretch(body) != 1.0 for body in bodies):
        at = "" if mechanism.temperature is None else f" at {mechanism.temperature:g} degC"
        return (
            f"{key} = {clearance:.6g} {unit}: with the expansion and growth of {' and '.join(bodies)}{at}, "
            f"{face} overlaps by {-gap:.6g} {unit} at the start; allowed: >= 0; give {owner} more "
            "play, or bodies that differ less"
        )
    if ".limits." in key:
        return (
            f"{key} = {clearance:.6g} {unit}: the joint is {-gap:.6g} {unit} beyond it at the start; "
            "allowed: limits on both sides of the start; widen them, or move the bodies"
        )
    stated = get_value(mechanism, key)
    leaves = "" if stated == clearance else f" leaves a radial clearance of {clearance:.6g} {unit}"
    return (
        f"{key} = {stated:.6g} {unit}{leaves}: {face} is {clearance - gap:.6g} {unit} off its centred "
        f"place at the start; allowed: at least {clearance - gap:.6g} {unit}, or move the bodies"
    )


def _cannot_close(mechanism: Mechanism, held: list[BilateralRow], state: State) -> str:
    """Return the ideal joints that are open, those first that are off most."""
    worst = sorted(_open_joints(mechanism, held, state), key=lambda fault: -fault[0])
    return f"{_first(list(dict.fromkeys(line.partition(':')[0] for _, line in worst)))} cannot be closed"


def _open_joints(mechanism: Mechanism, held: list[BilateralRow], state: State) -> Iterator[tuple[float, str]]:
    """Yield how far an ideal joint is open, as a length, and a line about it.

    A joint is open if its points are apart along a direction that it holds, or its axes are inclined (an angle times
    the arm), by more than 1e-5 of the arm and more than `simulation.penetration`.
    """
    if not held:
        return
    rows, n = bilateral_arrays(held), len(held)
    violation = np.zeros(n)
    row_violations(rows, state.x, state.R, np.zeros(n), violation, np.zeros((n, 3)), np.zeros((n, 3)))
    joints = np.array([row.name.partition(".")[0] for row in held])
    for joint in dict.fromkeys(joints.tolist()):
        slides, turns = (joints == joint) & (rows.kind == SLIDE), (joints == joint) & (rows.kind == TURN)
        yield from _open(mechanism, joint, np.linalg.norm(violation[slides]), np.linalg.norm(violation[turns]))


def _allowed(mechanism: Mechanism, joint: str) -> float:
    """Return what an ideal joint may be off at the start, a length."""
    arm = turning_arm(mechanism, [side.body for side in mechanism.joints[joint].sides])
    return max(mechanism.simulation.penetration, JOINT_TOLERANCE * arm)


def _open(mechanism: Mechanism, name: str, apart: Any, inclined: Any) -> Iterator[tuple[float, str]]:
    """Yield what is too large, with a line: the distance of a joint's points, the inclination of its axes as one."""
    joint, unit = mechanism.joints[name], mechanism.unit("length")
    arm, allowed = turning_arm(mechanism, [side.body for side in joint.sides]), _allowed(mechanism, name)
    sides = " and ".join(joint.SIDES)
    if not apart <= allowed:
        yield (
            float(apart),
            f"joints.{name}: the points of {sides} are {apart:.6g} {unit} apart along what the joint holds; "
            f"allowed: up to {allowed:.3g} {unit}; move a body, or correct one of the two points; "
            "where they vary, let one parameter give both",
        )
    if not inclined <= allowed:
        yield (
            float(inclined),
            f"joints.{name}: the axes of {sides} are {inclined / arm:.6g} rad apart; "
            f"allowed: up to {allowed / arm:.3g} rad; turn a body, or correct one of the two axes",
        )
