"""What looks wrong in the small motions about the start pose: no load, no damping, too early rest, joints held twice.

Along a motion without any load no force, spring or gravity determines where a body ends up. If the mechanism has
responses, only motions measured by one of them matter; otherwise all of them.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations, product

import numpy as np

from engine.arrays import Array
from engine.assembly import Assembly
from engine.assembly.frames import order_bodies
from engine.friction.arrays import dense_rows
from engine.kernels.bilateral import REDUNDANT, row_violations, whitened_bilateral_rows
from engine.kernels.model import State
from engine.kernels.responses import measure
from engine.mechanism import Mechanism, get_value, unit_of
from engine.mechanism.bushings import Yielding
from engine.mechanism.couplings import GearPair
from engine.not_at_rest.diagnosis import motion_words
from engine.platform.linear_algebra import one_thread
from engine.preflight.plausibility import Caution
from engine.preflight.small_motions import NOTHING, SmallMotions, accelerations, displaced, null_space, small_motions

SEEN = 0.05  # share of a response's gradient that is worth mentioning
BEGUN = 100.0  # number of small steps after which a motion has begun
ACTS = 1e-6  # share of a load along a motion above which it acts on it
SAME = 1e-6  # relative difference up to which two sizes are equal
PURE = 0.05  # share of a motion's energy that is worth mentioning

SLOW = 1e6  # windows: a play that takes longer to close has no load
SHORT = 4.0  # windows: a run does not wait for a play of a joint that takes longer than this to close


def unloaded_cautions(mechanism: Mechanism, small: SmallMotions) -> Iterator[Caution]:
    """Yield cautions about bodies along motions without load that a response at the end, if there is any, measures."""
    if mechanism.motions:  # they push bodies in ways that the start pose does not show
        return
    if not mechanism.responses:
        for body_name, motion in unloaded_motions(mechanism, small):
            yield _caution(body_name, motion, "")
        return
    unloaded = _unloaded(mechanism, small)
    names = list(mechanism.responses)
    found: dict[tuple[str, str], list[str]] = {}
    gradients = small.derivative(lambda pose: values_at(small, pose))
    for i in np.flatnonzero(small.assembly.model.responses.measures_motion):
        seen = unloaded @ (unloaded.T @ gradients[i])
        if np.linalg.norm(seen) > SEEN * np.linalg.norm(gradients[i]):
            body = int((seen.reshape(-1, 6) ** 2).sum(axis=1).argmax())
            if _is_thrown(mechanism, small, body, seen):
                continue
            found.setdefault(_words(mechanism, small, body, seen), []).append(names[i])
    for (body_name, motion), responses in found.items():
        measure = "measures" if len(responses) == 1 else "measure"
        yield _caution(body_name, motion, f", and {', '.join(responses)} {measure} that")


def unloaded_motions(mechanism: Mechanism, small: SmallMotions) -> Iterator[tuple[str, str]]:
    """Yield the motions without any load, each as the body that takes the largest part in it and a description."""
    if any(body.fixed for body in mechanism.bodies.values()):  # otherwise all could move together
        for body, y in _pure_motions(_unloaded(mechanism, small)):
            if not _is_brought_back(mechanism, small, y):
                yield _words(mechanism, small, body, y)


def _pure_motions(basis: Array) -> Iterator[tuple[int, Array]]:
    """Yield as many motions as a basis, shape (n, k), has columns, with the body of each.

    Each is the one with the largest share of its energy in the translation, or in the rotation, of one body; among
    equivalent bodies the first, among equivalent directions the one nearest to a world axis.
    """
    while basis.shape[1]:
        blocks = basis.reshape(-1, 3, basis.shape[1])
        ways, sizes, parts = np.linalg.svd(blocks)
        block = int(np.flatnonzero(sizes[:, 0] > (1.0 - SAME) * sizes[:, 0].max())[0])
        alike = int(np.count_nonzero(sizes[block] > (1.0 - SAME) * sizes[block, 0]))
        across = ways[block, :, :alike]
        axis = int((across**2).sum(axis=1).argmax())
        chosen = parts[block, :alike].T @ across[axis]
        chosen /= np.linalg.norm(chosen)
        yield block // 2, basis @ chosen
        basis = basis @ null_space(chosen[None], len(chosen))


def _is_brought_back(mechanism: Mechanism, small: SmallMotions, y: Array) -> bool:
    """Return whether loads act on a motion once it has begun, as gravity does on a pendulum hanging straight down."""
    moving = y != 0.0
    begun = BEGUN * float((small.steps()[moving] / np.abs(y[moving])).min()) * (small.root @ y)
    state, phases = displaced(small.assembly.state, begun), range(len(mechanism.phases))
    if not any(small.loads(phase, 0.0, state).any() for phase in phases):
        return False
    there = small_motions(replace(small.assembly, state=state))
    free = null_space(np.vstack([there.joints, there.rounds]), len(y))
    along = free @ (free.T @ np.linalg.solve(there.root, small.root @ y))
    loads = [there.loads(phase, 0.0) for phase in phases]
    return any(abs(float(along @ load)) > ACTS * float(np.linalg.norm(load)) for load in loads)


def _caution(body: str, motion: str, measured: str) -> Caution:
    """Return the caution about a body along a motion without any load."""
    remedy = "load or hold it there: otherwise it stays where the start or a push leaves it, or floats on for ever"
    text = f"no force, spring or gravity acts on it {motion}{measured}"
    return Caution(f"bodies.{body}", text=text, remedy=remedy)


def values_at(small: SmallMotions, pose: State) -> Array:
    """Return all responses at a pose, as measured at one instant."""
    model, work = small.assembly.model, small.assembly.work
    values = model.responses.offset.copy()
    measure(model, pose, work.sites, work.bilateral, values, work.vectors, (0.0, 1.0))
    return np.asarray(np.nan_to_num(values))


def _unloaded(mechanism: Mechanism, small: SmallMotions) -> Array:
    """Return a basis, (n, k), of the motions that no loads of a phase, their changes or contacts they close act on."""
    n = len(small.root)
    free = null_space(np.vstack([small.joints, small.rounds]), n)
    horizon, varies = mechanism.simulation.horizon, len(small.assembly.model.time_laws.since) > 0
    times = (0.0, 0.5 * horizon, horizon) if varies else (0.0,)
    flat, rows = small.normals[~small.is_round], [np.zeros((0, n))]
    for phase in range(len(mechanism.phases)):
        for t in times:
            loads = small.loads(phase, t)
            moves, forces = accelerations(free, flat, loads)
            rows.append(flat[forces > NOTHING * np.linalg.norm(loads)])
            rows.append(_by_body(moves, NOTHING * float(np.linalg.norm(loads))))
            rows.append(small.derivative(partial(small.loads, phase, t)))
    return np.asarray(free @ null_space(np.vstack(rows) @ free, free.shape[1]))


def _by_body(moves: Array, least: float) -> Array:
    """Return the part of a motion for each body that moves by more than ``least``, one row each."""
    nb = len(moves) // 6
    rows = np.zeros((nb, nb, 6))
    rows[np.arange(nb), np.arange(nb)] = moves.reshape(nb, 6)
    return np.asarray(rows.reshape(nb, -1)[np.abs(moves.reshape(nb, 6)).max(axis=1) > least])


def _is_thrown(mechanism: Mechanism, small: SmallMotions, body: int, y: Array) -> bool:
    """Return whether a body starts with a speed in a motion that friction will end, which decides where it stops."""
    name, twist, R = order_bodies(mechanism)[body], small.assembly.state.v[body], small.assembly.state.R[body]
    own = (small.root @ y)[6 * body : 6 * body + 6]
    along = abs(float(own[:3] @ twist[:3] + own[3:] @ (R @ twist[3:])))
    pairs = [*mechanism.contacts.values(), *(joint for joint in mechanism.joints.values() if not joint.ideal)]
    rubs = any(mechanism.contact_law(pair)[0] > 0.0 for pair in pairs if name in {side.body for side in pair.sides})
    return rubs and along > NOTHING * float(np.linalg.norm(own) * np.linalg.norm(twist))


def _words(mechanism: Mechanism, small: SmallMotions, body: int, y: Array) -> tuple[str, str]:
    """Return a body's name, and a description of its part in a motion."""
    parts = y.reshape(-1, 2, 3)[body]
    energies = (parts**2).sum(axis=1)
    y = np.where((energies > PURE * energies.sum())[:, None], parts, 0.0)
    own = small.root[6 * body : 6 * body + 6, 6 * body : 6 * body + 6]
    name, w = order_bodies(mechanism)[body], (own @ y.ravel()).reshape(2, 3)
    return name, motion_words(mechanism, name, small.assembly.state.R[body], w[0], w[1])


def early_rest(mechanism: Mechanism, small: SmallMotions) -> Iterator[Caution]:
    """Yield the slowest play that is still open when the mechanism may count as being at rest.

    At the start everything is at rest. If the loads move no measured length by more than the allowed drift within the
    window, the run ends there although its bodies have only begun to slide or turn. If they do, a body that is not
    measured may still move later, when the measured ones stand still. A run waits only for bodies in flight.
    """
    rest, assembly = mechanism.simulation.rest, small.assembly
    window = max(rest.window, mechanism.simulation.step)
    touching = small.normals[assembly.state.gap <= max(mechanism.simulation.penetration, rest.drift)]
    moves, _ = accelerations(null_space(small.joints, len(small.root)), touching, small.loads(0, 0.0))
    gradients = small.derivative(lambda pose: values_at(small, pose))
    measured = gradients[assembly.model.responses.measures_motion] @ moves
    seen = assembly.state.v.any() or 0.5 * np.abs(measured).max(initial=0.0) * window**2 > rest.drift
    slowest, which = 0.0, ""
    for i, name in enumerate(assembly.contact_names):
        play, towards = float(assembly.state.gap[i]), _approach(small, i, moves)
        takes = float(np.sqrt(2.0 * play / towards)) if towards > 0.0 and play > 0.0 else 0.0
        of_joint = name.partition(".")[0] not in mechanism.contacts
        long = SHORT * rest.window if seen and of_joint else SLOW * rest.window if seen else rest.window
        if max(long, slowest) < takes < SLOW * rest.window:
            slowest, which = takes, name
    if which:
        unit = mechanism.unit("time")
        meanwhile = "nothing that is measured moves at first: the run could end before"
        if seen:
            meanwhile = "a body that nothing measures counts as moving only in flight"
        text = f"the loads take {slowest:.3g} {unit} to close {_play(mechanism, which)}, and {meanwhile}"
        customary = f"more than {slowest:.2g} {unit}"
        yield Caution("simulation.rest.window", rest.window, unit, text, customary, "make the window longer")


def _approach(small: SmallMotions, contact: int, moves: Array) -> float:
    """Return the acceleration at which the gap of a contact closes."""
    if small.is_round[contact]:
        rows = small.rounds[small.round_of == contact]
        return float(np.linalg.norm(rows @ moves))
    return float(-small.normals[contact] @ moves)


def _play(mechanism: Mechanism, contact: str) -> str:
    """Return the name of the play at a contact, with its value if it is a number in the file."""
    joint, _, face = contact.partition(".")
    if joint in mechanism.contacts:
        return f"the gap of contacts.{joint}"
    if joint not in mechanism.joints or mechanism.joints[joint].ideal:
        return f"the gap of {contact}"
    key = f"joints.{joint}.{mechanism.joints[joint].face_clearance(face)}"
    return f"the play {key} = {get_value(mechanism, key):g} {unit_of(mechanism, key)}"


def undamped_modes(mechanism: Mechanism, small: SmallMotions) -> Iterator[Caution]:
    """Yield cautions about bodies that move from the start, are measured at the end, and lose no energy meanwhile."""
    if mechanism.motions or any(phase.damping for phase in mechanism.phases):
        return
    assembly, names = small.assembly, order_bodies(mechanism)
    loads = small.loads(0, 0.0)
    moves, _ = accelerations(null_space(small.joints, len(small.root)), small.normals, loads)
    start = assembly.state.v[:-1].copy()
    start[:, 3:] = np.einsum("bij,bj->bi", assembly.state.R[:-1], start[:, 3:])
    starts = np.linalg.solve(small.root, start.ravel()) if start.any() else start.ravel()
    gradients = small.derivative(lambda pose: values_at(small, pose))[assembly.model.responses.measures_motion]
    for group in _linked(mechanism):
        if any(_dissipates(mechanism, body) for body in group):
            continue
        own = np.isin(np.repeat(np.array(names), 6), sorted(group))
        goes = np.abs(gradients @ np.where(own, moves, 0.0)).max(initial=0.0)
        flies = np.abs(gradients @ np.where(own, starts, 0.0)).max(initial=0.0)
        size = np.linalg.norm(gradients) if gradients.size else 0.0
        if goes > NOTHING * size * np.linalg.norm(loads) or flies > NOTHING * size * np.linalg.norm(starts):
            text = "no contact, damper or damping of the phase takes energy from its motion: it never comes to rest"
            remedy = "add what damps it, or give the phase a duration if the motion is the result"
            yield Caution(f"bodies.{min(group, key=names.index)}", text=text, remedy=remedy)


def _linked(mechanism: Mechanism) -> list[set[str]]:
    """Return the groups of moving bodies that are linked by joints, couplings, contacts, springs or dampers."""
    groups = [{name} for name, body in mechanism.bodies.items() if not body.fixed]
    pairs = [{side.body for side in pair.sides} for pair in (*mechanism.joints.values(), *mechanism.contacts.values())]
    for link in (*mechanism.springs.values(), *mechanism.dampers.values()):
        pairs.append({end if isinstance(end, str) else end.body for end in (link.a, link.b)})
    for coupling in mechanism.couplings.values():
        if isinstance(coupling, GearPair):
            pairs.append({gear.body for gear in coupling.gears})
        else:
            pairs.append({side.body for term in coupling.terms for side in mechanism.joints[term.joint].sides})
    for pair in pairs:
        met = [group for group in groups if group & pair]
        groups = [group for group in groups if not group & pair] + ([set().union(*met)] if met else [])
    return groups


def _dissipates(mechanism: Mechanism, body: str) -> bool:
    """Return whether a contact, a joint with play, friction or damping, or a damper acts on a body."""
    for pair in (*mechanism.joints.values(), *mechanism.contacts.values()):
        smooth = getattr(pair, "ideal", False) and not any(
            getattr(pair, key, None) for key in ("friction_force", "friction_torque")
        )
        if isinstance(pair, Yielding):
            smooth = not any(pair.springs(1.0)[1])
        if not smooth and body in {side.body for side in pair.sides}:
            return True
    damped = [link for link in mechanism.springs.values() if link.damping] + [*mechanism.dampers.values()]
    return any(body == (end if isinstance(end, str) else end.body) for link in damped for end in (link.a, link.b))


# Closed loops of ideal joints that hold a motion twice, and which joints could let it go. A planar linkage of pins, for
# instance, is kept in its plane by each of its joints. It moves as it should, but how these share forces across the
# plane is open, and its axes have to fit.


SHARED = 1e-6  # share of a joint in what is held twice; anything smaller is a rounding error of zero
MOST_ROWS, MOST_JOINTS = 1000, 12  # that are examined; joints of one loop that are tried as others
# type of joint, the type that it could be, and the last parts of the names of its rows that this lets go
RELAXED: dict[str, dict[str, tuple[str, ...]]] = {
    "revolute": {"cylindrical": ("slide1",), "spherical": ("turn1", "turn2")},
    "prismatic": {"cylindrical": ("turn3",)},
}


def closed_loop_cautions(mechanism: Mechanism, assembly: Assembly) -> Iterator[Caution]:
    """Yield a caution for each group of ideal joints that hold motions more than once at the start pose."""
    rows = assembly.model.bilateral
    of_joints = (rows.law < 0) & rows.phase[:, 0]  # bushings hold in no phase
    names = [name for name, holds in zip(assembly.row_names, of_joints, strict=True) if holds]
    if not rows.closed[0] or len(names) > MOST_ROWS:
        return
    with one_thread():
        J = _rows(assembly)[of_joints]
        for joints in _groups(J, [name.rpartition(".")[0] for name in names]):
            inside = [i for i, name in enumerate(names) if name.rpartition(".")[0] in joints]
            rows, of = J[inside], [names[i] for i in inside]
            twice = len(rows) - _rank(rows)
            motions = "a motion" if twice == 1 else f"{twice} motions"
            text = f"the loop {'-'.join(joints)} holds {motions} twice: it moves freely only because its joints fit"
            text += " each other, and how they share forces is open"
            yield Caution(f"joints.{joints[0]}", text=text, remedy=_remedy(mechanism, joints, rows, of, twice))


def _rows(assembly: Assembly) -> Array:
    """Return the rows of joints and motions at the start, of length one in the metric of bodies of mass 1."""
    model, state, at_pose, system = assembly.model, assembly.state, assembly.work.bilateral, assembly.problem.bilateral
    row_violations(
        model.bilateral, state.x, state.R, at_pose.target[1], at_pose.violation, at_pose.point, at_pose.direction
    )
    whitened_bilateral_rows(model.metric, model.bilateral, state.x, state.R, at_pose.point, at_pose.direction, system.J)
    rows = dense_rows(system.node, system.J[:, None], assembly.problem.w.size)[:, 0]
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0.0))


def _rank(rows: Array) -> int:
    """Return how many rows are independent."""
    return int(np.count_nonzero(np.linalg.svd(rows, compute_uv=False) > REDUNDANT)) if len(rows) else 0


def _groups(J: Array, joints: list[str]) -> list[list[str]]:
    """Return groups of joints whose rows depend on each other, in the file's order; ``joints`` has that of each row."""
    from scipy.sparse.csgraph import connected_components

    ways, sizes, _ = np.linalg.svd(J)
    open_ways = ways[:, np.count_nonzero(sizes > REDUNDANT) :]
    shared = np.abs(open_ways @ open_ways.T)
    order = list(dict.fromkeys(joints))
    member = np.array([[joint == name for joint in joints] for name in order])
    linked = member @ (shared > SHARED) @ member.T
    _, group = connected_components(linked, directed=False)
    shares = dict.fromkeys(group[np.diag(linked)].tolist())
    return [[name for name, own in zip(order, group, strict=True) if own == each] for each in shares]


def _remedy(mechanism: Mechanism, joints: list[str], rows: Array, names: list[str], twice: int) -> str:
    """Return which one or two joints of a loop could be of another type, so that it holds nothing twice."""
    options = [
        [(joint, kind, tuple(f"{joint}.{row}" for row in parts)) for kind, parts in RELAXED.get(now, {}).items()]
        for joint, now in ((joint, str(mechanism.joints[joint].type)) for joint in joints[:MOST_JOINTS])
    ]
    for count in (1, 2):
        for chosen in combinations(options, count):
            for changes in product(*chosen):
                gone = {row for *_, parts in changes for row in parts}
                kept = [i for i, name in enumerate(names) if name not in gone]
                # exactly what is held twice goes, and nothing else begins to move
                if len(gone) == twice and _rank(rows[kept]) == len(kept):
                    return "to change that, make " + " and ".join(f"{joint} {kind}" for joint, kind, _ in changes)
    return "to change that, give one of its joints play, or fewer constraints"
