"""The small motions of a mechanism about its start pose: the freedom left by joints and contacts, and the loads.

The unknowns are the velocities of all moving bodies, six each: of the centre of mass and about it, in world axes. They
are whitened, y = M^1/2 w, so that the squared length of y measures energy. `free` contains the motions that ideal
joints allow and that do not move any all-round contact (a pin in a bore, a ball in a socket) out of its place.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from engine.arrays import Array, Integers
from engine.assembly import Assembly
from engine.kernels.bilateral import row_violations
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.loads import apply_loads
from engine.kernels.model import GEARS, ON_BALL, ON_EXTRUDED, ON_ROUND, ON_SURFACE, ON_TURNED, RING_BORE, SLIDE, State
from engine.platform.linear_algebra import nonnegative_least_squares

ROUND = 0.3  # sine of an angle: a contact whose normals differ by less than this is flat
NOTHING = 1e-9  # relative size below which a number is a rounding error of zero
SMALL = 1e-5  # a small displacement, as an angle and as a share of a radius of gyration
SOFT = 1e-6  # common compliance of all contacts, so that those that can share a load do


@dataclass(frozen=True)
class SmallMotions:
    """A mechanism about its start pose, with `n` velocities in total."""

    assembly: Assembly  # the mechanism at its start
    root: Array  # (n, n), M^-1/2: w = root y
    joints: Array  # (nj, n), rows of the ideal joints, in y
    normals: Array  # (nc, n), rows of the gaps of all contacts at the start pose, in y
    rounds: Array  # (nr, n), rows of the directions in which an all-round contact holds, in y
    round_of: Integers  # (nr,), the contact of each of these rows

    @property
    def is_round(self) -> NDArray[np.bool_]:
        """Whether each contact is all round, shape (nc,)."""
        return np.isin(np.arange(len(self.normals)), self.round_of)

    def loads(self, phase: int, t: float, state: State | None = None) -> Array:
        """Return the forces and torques of a phase on all bodies, shape (n,), in y; optionally at another pose."""
        model, work = self.assembly.model, self.assembly.work
        state = state or self.assembly.state
        apply_loads(model.bodies, model.loads, model.time_laws, state, phase, t, work.wrench, work.vectors)
        return np.asarray(self.root.T @ work.wrench[:-1].ravel())

    def derivative(self, measured: Callable[[State], Array]) -> Array:
        """Return the derivative of a function of the pose, shape (m, n), in y; zero where rounding hides it."""
        size, columns = float(np.abs(measured(self.assembly.state)).max(initial=0.0)), []
        for j, step in enumerate(self.steps()):
            forth, back = (displaced(self.assembly.state, sign * step * self.root[:, j]) for sign in (1.0, -1.0))
            column = (measured(forth) - measured(back)) / (2.0 * step)
            columns.append(np.where(np.abs(column) * step > NOTHING * size, column, 0.0))
        return np.array(columns).T

    def steps(self) -> Array:
        """Return a small step for each y: a small share of the radius of gyration, or a small angle."""
        bodies = self.assembly.model.bodies
        arms = np.sqrt(np.trace(bodies.inertia, axis1=1, axis2=2) / (2.0 * bodies.mass))
        lengths = np.repeat(np.stack([arms, np.ones_like(arms)], axis=1).ravel(), 3)
        return np.asarray(SMALL * lengths / np.abs(self.root).max(axis=0))


def small_motions(assembly: Assembly) -> SmallMotions:
    """Return the small motions of a mechanism at its start."""
    bodies, state = assembly.model.bodies, assembly.state
    nb = len(bodies.mass)
    root = np.zeros((6 * nb, 6 * nb))
    for b in range(nb):
        inertia = state.R[b] @ bodies.inertia[b] @ state.R[b].T
        root[6 * b : 6 * b + 3, 6 * b : 6 * b + 3] = np.eye(3) / np.sqrt(bodies.mass[b])
        root[6 * b + 3 : 6 * b + 6, 6 * b + 3 : 6 * b + 6] = np.linalg.inv(np.linalg.cholesky(inertia)).T
    normals = _contact_rows(assembly, state) @ root
    return SmallMotions(assembly, root, _joint_rows(assembly) @ root, normals, *_rounds(assembly, root))


def displaced(state: State, w: Array) -> State:
    """Return the state with its bodies displaced by ``w``, shape (6 nb,): lengths, and angles about world axes."""
    x, p, R = state.x.copy(), state.p.copy(), state.R.copy()
    for b, (shift, turn) in enumerate(w.reshape(-1, 2, 3)):
        x[b] += shift
        if not turn.any():
            continue
        turned = Rotation.from_rotvec(turn) * Rotation.from_matrix(R[b])
        R[b], p[b] = turned.as_matrix(), turned.as_quat(canonical=False, scalar_first=True)
        # p and -p are the same rotation; a jump of the sign would spoil differences between poses
        p[b] *= 1.0 if p[b] @ state.p[b] >= 0.0 else -1.0
    return state._replace(x=x, p=p, R=R)


def null_space(rows: Array, n: int) -> Array:
    """Return an orthonormal basis, shape (n, k), of the null space of rows, regardless of the lengths of the rows."""
    lengths = np.linalg.norm(rows, axis=1)
    rows = rows[lengths > 0.0] / lengths[lengths > 0.0, None]
    if not len(rows):
        return np.eye(n)
    _, sizes, directions = np.linalg.svd(rows)
    return np.asarray(directions[int(np.count_nonzero(sizes > 1e-6)) :].T)


def accelerations(free: Array, normals: Array, loads: Array) -> tuple[Array, Array]:
    """Return how the bodies start to move under loads, (n,), and how hard the contacts press, (nc,), without friction.

    By Gauss's principle, this is the motion nearest to that of the loads alone among all that close no contact. `free`
    (n, k) is a basis of the possible motions, `normals` (nc, n) are the rows of the closed contacts.
    """
    size = float(np.linalg.norm(loads))
    wanted, rows = free.T @ loads, normals @ free
    if not np.linalg.norm(wanted) > NOTHING * size:
        return np.zeros(len(loads)), np.zeros(len(rows))
    if not len(rows):
        return free @ wanted, np.zeros(0)
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > NOTHING)
    system = np.vstack([rows.T, np.sqrt(SOFT) * np.eye(len(rows))])
    pressed = nonnegative_least_squares(system, np.concatenate([-wanted / size, np.zeros(len(rows))]))
    left = null_space(rows[pressed > NOTHING], len(wanted))
    moving = left @ (left.T @ wanted)
    moving[np.abs(moving) < NOTHING * size] = 0.0
    return free @ moving, size * pressed


def _joint_rows(assembly: Assembly) -> Array:
    """Return the rows of ideal joints, motions that act at the start, couplings and gears, shape (nj, 6 nb)."""
    rows, state, at_pose = assembly.model.bilateral, assembly.state, assembly.work.bilateral
    # restored below: these rows are the assembly's own, and the next call must find them as they were
    acts = rows.acts.copy()
    rows.acts[:] = rows.phase[:, 0] if rows.phase.size else True
    row_violations(rows, state.x, state.R, at_pose.target[1], at_pose.violation, at_pose.point, at_pose.direction)
    found = _rows(state, (rows.a, rows.b), -at_pose.direction, at_pose.point, rows.kind != 0)
    rows.acts[:] = acts
    return np.vstack([found, _coupling_rows(assembly), _gear_rows(assembly)])


def _coupling_rows(assembly: Assembly) -> Array:
    """Return the rows of the couplings of joint coordinates, without their backlash, shape (couplings, 6 nb)."""
    terms, state = assembly.model.contacts.terms, assembly.state
    a, b, row = terms.body[:, 0], terms.body[:, 1], terms.geometry
    along = np.einsum("kij,kj->ki", state.R[a], row[:, 3:6])
    point = state.x[b] + np.einsum("kij,kj->ki", state.R[b], row[:, 6:9])
    rows = terms.factor[:, None] * _rows(state, (b, a), along, point, terms.kind != SLIDE)
    return np.add.reduceat(rows, terms.first[:-1]) if rows.size else rows


def _gear_rows(assembly: Assembly) -> Array:
    """Return the rows of one flank of each pair of gears, as if they had no backlash, shape (pairs, 6 nb)."""
    contacts = assembly.model.contacts
    rows = _contact_rows(assembly, assembly.state)
    return np.asarray(rows[(contacts.kind == GEARS) & (contacts.flank > 0.0)])


def _contact_rows(assembly: Assembly, state: State) -> Array:
    """Return the rows of the gaps of all contacts, shape (nc, 6 nb)."""
    contacts, sites = assembly.model.contacts, assembly.work.sites
    find_contacts(contacts, state.x, state.R, assembly.work.gap, sites.point, sites.frame)
    return _rows(state, (contacts.a, contacts.b), sites.frame[:, 0], sites.point, np.zeros(len(contacts.a), bool))


def _rows(
    state: State, sides: tuple[Integers, Integers], direction: Array, point: Array, is_spin: NDArray[np.bool_]
) -> Array:
    """Return the rows, (n, 6 nb), of the velocity of bodies a relative to b along directions at points, or the spin."""
    nb = len(state.x) - 1
    rows = np.zeros((len(direction), nb, 2, 3))
    for body, sign in zip(sides, (1.0, -1.0), strict=True):
        at = np.flatnonzero(body < nb)
        along, spins, moved = sign * direction[at], is_spin[at, None], body[at]
        arm = np.where(spins, 0.0, point[at] - state.x[moved])
        rows[at, moved, 0] += np.where(spins, 0.0, along)
        rows[at, moved, 1] += np.where(spins, along, np.cross(arm, along))
    return rows.reshape(len(direction), 6 * nb)


def _rounds(assembly: Assembly, root: Array) -> tuple[Array, Integers]:
    """Return the rows in which all-round contacts hold, in y, and the contact of each; a row's speed is that of a gap.

    The bodies are displaced until the gaps would be closed: the normal of a pin in a bore then covers all directions,
    whereas that of a face hardly turns.
    """
    contacts, state, nb = assembly.model.contacts, assembly.state, len(assembly.model.bodies.mass)
    curved = np.isin(contacts.kind, (RING_BORE, ON_ROUND, ON_BALL, ON_TURNED, ON_EXTRUDED, ON_SURFACE))
    rows: list[dict[int, list[Array]]] = [{} for _ in contacts.kind]  # by contact and the body that was moved
    normals: list[dict[int, list[Array]]] = [{} for _ in contacts.kind]
    plays = _plays(assembly, np.flatnonzero(curved))
    for group in _apart(assembly, plays):
        own = curved & (np.isin(contacts.a, group) | np.isin(contacts.b, group))
        for direction in (*np.eye(3), *-np.eye(3)):
            w = np.zeros((nb, 2, 3))
            w[group, 0] = np.array([plays[body] for body in group])[:, None] * direction
            there = _contact_rows(assembly, displaced(state, w.ravel())) @ root
            for i in np.flatnonzero(own):
                body = int(contacts.a[i] if contacts.a[i] in group else contacts.b[i])
                rows[i].setdefault(body, []).append(there[i])
                normals[i].setdefault(body, []).append(assembly.work.sites.frame[i, 0].copy())
    held, of = [np.zeros((0, len(root)))], [np.zeros(0, np.int64)]
    for i in np.flatnonzero(curved):
        turned, moves = (np.concatenate([each[i][body] for body in sorted(each[i])]) for each in (normals, rows))
        across, spread, _ = np.linalg.svd(turned.T, full_matrices=False)
        ways = across[:, spread > ROUND * np.sqrt(len(turned))]
        if ways.shape[1] > 1:
            # from all normals, one row for each principal direction: its speed is that of the gap along it
            held.append(np.linalg.pinv(turned @ ways) @ moves)
            of.append(np.full(ways.shape[1], i))
    return np.vstack(held), np.concatenate(of)


def _plays(assembly: Assembly, curved: Integers) -> dict[int, float]:
    """Return how far each body has to be moved to close the gaps of its curved contacts; only bodies that have any."""
    contacts, plays = assembly.model.contacts, {}
    for body in range(len(assembly.model.bodies.mass)):
        own = [i for i in curved if body in (contacts.a[i], contacts.b[i])]
        if own:
            play = max(1.5 * abs(float(assembly.state.gap[i])) + 3.0 * max(contacts.clearance[i], 0.0) for i in own)
            plays[body] = play or 1e-6 * float(contacts.reach[own].max())
    return plays


def _apart(assembly: Assembly, plays: dict[int, float]) -> list[list[int]]:
    """Return bodies in groups in which none touches another, so that all of a group can be moved at once."""
    pairs = {frozenset(pair) for pair in zip(assembly.model.contacts.a, assembly.model.contacts.b, strict=True)}
    groups: list[list[int]] = []
    for body in plays:
        group = next((each for each in groups if not any(frozenset((body, x)) in pairs for x in each)), None)
        if group is None:
            groups.append(group := [])
        group.append(body)
    return groups
