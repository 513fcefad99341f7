"""Contact forces at rest: among all forces that balance the loads, those of equally stiff contacts.

When all contacts stick, the forces are not unique: friction at redundant contacts leaves a continuum of solutions. The
reported forces are the limit of equally compliant contacts, u = -c r, as the compliance c tends to zero. They depend on
the pose alone, not on its history. Ideal joints and prescribed motions can carry any load.
"""

import math

import numpy as np

from engine.arrays import Array, Integers, copied
from engine.assembly import Assembly
from engine.friction.arrays import dense_rows
from engine.friction.balanced_forces import nearest_balanced
from engine.friction.blocks import ROW
from engine.friction.indeterminacy import force_ranges
from engine.kernels.compliance import elastic_force
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.loads import apply_loads
from engine.kernels.model import CONTACT_FORCE, DERIVED, END
from engine.kernels.motion import move
from engine.kernels.responses import measure
from engine.kernels.rest import LOADED
from engine.kernels.statics import HELD, MOVES, MOVING, effect_on_bodies, hold_loads
from engine.mechanism import Mechanism
from engine.platform.linear_algebra import one_thread

SHORT = 1e-3  # of a step: the free motion of an unloaded step then has no gyroscopic part


class PoseAtRest:
    """A mechanism at rest, held in copies of the arrays that its run writes, so that the run can continue undisturbed.

    The next pose of the same assembly overwrites these copies.

    ``reported`` holds the values of the responses, with the contact forces ``forces``, (nc, 3), as determined by the
    pose; None if none in the friction cones were found that balance the loads. ``moves`` is true if responses measure
    contact forces, no forces balance the loads, and bodies start to move, with the twists in ``assembly``.
    ``ambiguous`` is true if bodies would start to move with contacts that press only as much as they must, but the
    forces of the run hold them.
    """

    def __init__(self, mechanism: Mechanism, assembly: Assembly, phase: int, t: float, h: float) -> None:
        """Find the contact forces that balance the loads of ``phase`` at time ``t``; the last step had length ``h``."""
        self.assembly = assembly.copied()
        sim = mechanism.simulation
        self.forces = forces_at_rest(self.assembly, phase, sim.step, touching_gap(mechanism), t)
        self.ambiguous, state = False, self.assembly.state
        if self.forces is None and is_balanced(self.assembly, state.r / h, sim.step):
            self.forces = balancing_forces(self.assembly, np.zeros_like(state.r), sim.step)
            if self.forces is not None:
                self.ambiguous = bool(state.v.any())
                state.v[:] = 0.0
        self.moves = False
        self.reported = self.assembly.work.reported
        if (assembly.model.responses.kind >= CONTACT_FORCE).any():
            self.moves = self.forces is None and bool(self.assembly.state.v.any())
            self._measure(phase, t)

    def _measure(self, phase: int, t: float) -> None:
        """Evaluate the contact-force responses with the forces at rest; they are NaN if no forces balance the loads."""
        model, state, work = self.assembly.model, self.assembly.state, self.assembly.work
        state.r[:] = math.nan if self.forces is None else self.forces
        # the length of the step is 1, because state.r holds forces here, not impulses; at rest a mean is the force
        at_rest = model._replace(responses=model.responses._replace(averaged_over=np.zeros(len(self.reported))))
        if model.bilateral.read[0]:
            work.bilateral.force[:] = math.nan if self.forces is None else self._forces_of_rows(self.forces, phase, t)
        measure(at_rest, state, work.sites, work.bilateral, work.values, work.vectors, (t, 1.0))
        read = model.responses
        # speeds keep their values, and so do responses that were read at the end of an earlier phase
        forces_at_end = (read.at == END) & (read.kind >= CONTACT_FORCE) & (read.to_phase == phase)
        self.reported[forces_at_end] = work.values[forces_at_end]
        work.at_impact[forces_at_end] = False

    def _forces_of_rows(self, forces: Array, phase: int, t: float) -> Array:
        """Return the forces, or torques, with which ideal joints and motions hold the loads and the contact forces."""
        model, state, work, problem = self.assembly.arrays
        bodies, wrench, n = model.bodies, np.zeros_like(work.wrench), problem.w.size
        apply_loads(bodies, model.loads, model.time_laws, state, phase, t, wrench, work.vectors)
        load = np.zeros(n)
        for body, node in enumerate(bodies.node):
            k = ROW * node
            load[k : k + 3] = wrench[body, :3] / np.sqrt(bodies.mass[body])
            load[k + 3 : k + 6] = bodies.inverse_root[body] @ (state.R[body].T @ wrench[body, 3:])
        touching = _touching(self.assembly)
        effect = np.zeros((3 * touching.size, n))
        effect_on_bodies(problem.rows, np.arange(touching.size), effect)
        load += effect.T @ forces[touching].ravel()
        with one_thread():
            J = dense_rows(problem.bilateral.node, problem.bilateral.J[:, None], n)[:, 0]
            return np.asarray(model.bilateral.arm * np.linalg.lstsq(J.T, -load, rcond=None)[0])

    def hand_over(self, run: Assembly) -> None:
        """Let a run go on with these forces: as reported ones, and as those at the beginning of the next phase."""
        run.work.reported[:], run.work.at_impact[:] = self.reported, self.assembly.work.at_impact
        kind = run.model.responses.kind
        forces = (kind >= CONTACT_FORCE) & (kind != DERIVED)
        run.work.values[forces] = self.assembly.work.values[forces]

    def ranges(self, contacts: list[str]) -> dict[str, tuple[float, float]]:
        """Return contact -> smallest and largest normal force that friction allows; empty if no forces were found."""
        if self.forces is None or not contacts:
            return {}
        groups = [self.assembly.numbers(contact) for contact in contacts]
        return dict(zip(contacts, normal_force_ranges(self.assembly, self.forces, groups), strict=True))


def touching_gap(mechanism: Mechanism) -> float:
    """Return the largest gap of a closed contact at rest: the drift that is allowed there."""
    return max(mechanism.simulation.penetration, mechanism.simulation.rest.drift)


def forces_at_rest(assembly: Assembly, phase: int, h: float, touching_gap: float, t: float = 0.0) -> Array | None:
    """Return the contact forces, (nc, 3), that balance the loads of ``phase`` at time ``t`` in this pose, or None.

    None: the touching contacts cannot hold the loads; the twists give the motion that starts, at an arbitrary scale, or
    zero if no forces were found. Contacts touch with a gap up to ``touching_gap`` or after a load in the last step;
    ``work.chosen`` receives their numbers, then -1.
    A pose that springs would hold counts as held if it is at most ``touching_gap`` away. ``h``: any positive time.
    """
    h *= SHORT
    find_contacts_at_pose(assembly)
    status, nc = hold_loads(assembly.arrays, phase, t, h, touching_gap)
    assembly.work.chosen[nc:] = -1
    if status == MOVES and _balance_is_near(assembly, phase, t, touching_gap):
        assembly.state.v[:] = 0.0
    elif status != HELD:
        return None
    touching, forces = assembly.work.chosen[:nc], np.zeros_like(assembly.state.r)
    forces[touching] = assembly.work.u[touching] / h
    return forces


def find_contacts_at_pose(assembly: Assembly) -> None:
    """Write gaps, points and frames of all contacts at the current pose into the workspace."""
    state, work = assembly.state, assembly.work
    find_contacts(assembly.model.contacts, state.x, state.R, work.gap, work.sites.point, work.sites.frame)


def _balance_is_near(assembly: Assembly, phase: int, t: float, length: float) -> bool:
    """Return whether springs stop the starting motion within a length, because the loads stop driving it there.

    Where only springs hold a body, the loads balance at a single pose, which a run approaches without ever reaching it.
    """
    model, work, there = assembly.model, assembly.work, copied(assembly.state)
    begins, wrench = there.v[:-1].copy(), np.zeros_like(work.wrench)
    spin_energy = np.einsum("bi,bij,bj->b", begins[:, 3:], model.bodies.inertia, begins[:, 3:])
    speed = float(np.sqrt((begins[:, :3] ** 2).sum(axis=1) + spin_energy / model.bodies.mass).max())
    if not speed > 0.0:
        return False
    move(there, length / speed)
    there.v[:] = 0.0
    apply_loads(model.bodies, model.loads, model.time_laws, there, phase, t, wrench, work.vectors)
    spins = np.einsum("bij,bj->bi", there.R[:-1], begins[:, 3:])
    return float((wrench[:-1, :3] * begins[:, :3]).sum() + (wrench[:-1, 3:] * spins).sum()) <= 0.0


def is_balanced(pose: Assembly, forces: Array, h: float) -> bool:
    """Return whether forces, (nc, 3), balance the loads, to within what counts as rest.

    ``pose`` is as `forces_at_rest` left it with this ``h``.
    """
    touching, load = _touching(pose), _load(pose, h)
    left = load + _weights(pose) - _balance(pose, touching.size).T @ forces[touching].ravel()
    return float(left @ left) <= MOVING * float(load @ load)


def balancing_forces(pose: Assembly, nearest_to: Array, h: float, only_loaded: bool = False) -> Array | None:
    """Return the forces within the cones, (nc, 3), that balance the loads and lie nearest to others; None without any.

    Of contacts that touch, or with ``only_loaded`` carry load in the others. ``pose`` is as for `is_balanced`.
    """
    touching = _touching(pose)
    rows = _balance(pose, touching.size).reshape(touching.size, 3, -1)
    if only_loaded:
        loaded = nearest_to[touching, 0] > LOADED * nearest_to[:, 0].max(initial=0.0)
        touching, rows = touching[loaded], rows[loaded]
    with one_thread():
        H, mu = rows.reshape(3 * touching.size, -1), holding_friction(pose)[touching]
        found = nearest_balanced(H, _load(pose, h) + _weights(pose), mu, nearest_to[touching])
    if found is None:
        return None
    forces = np.zeros_like(nearest_to)
    forces[touching] = found
    return forces


def holding_friction(pose: Assembly) -> Array:
    """Return the coefficients of friction of contacts that stick, as all do at rest, (nc,)."""
    laws = pose.model.laws
    return laws.sticking if laws.sticking.size else laws.mu


def _touching(pose: Assembly) -> Integers:
    return pose.work.chosen[pose.work.chosen >= 0]


def _load(pose: Assembly, h: float) -> Array:
    """Return the forces that contacts have to balance, per unknown of the friction problem, in the mass metric."""
    bodies, fall = pose.model.bodies, pose.work.free[:-1]
    load = np.zeros(pose.problem.w.size)
    for body, node in enumerate(bodies.node):
        k = ROW * node
        load[k : k + 3] = -np.sqrt(bodies.mass[body]) * fall[body, :3]
        load[k + 3 : k + 6] = -bodies.inverse_root[body] @ bodies.inertia[body] @ fall[body, 3:]
    return load / (SHORT * h)


def _weights(pose: Assembly) -> Array:
    """Return the same for what presses joint friction and compliant contacts, see `kernels.contacts.press`."""
    load, contacts, rows = np.zeros(pose.problem.w.size), pose.model.contacts, pose.problem.rows
    for j, i in enumerate(_touching(pose)):
        if contacts.weight[i, 0] >= 0:
            press = contacts.breakaway[i] + elastic_force(contacts, i, -pose.work.gap[i])
            load[ROW * contacts.weight[i, 0]] = press * rows.G[j, 0, 2 * ROW]
    return load


def normal_force_ranges(assembly: Assembly, forces: Array, wanted: list[list[int]]) -> list[tuple[float, float]]:
    """Return the smallest and largest normal force of groups of contacts among all with the balance of ``forces``.

    The problem is as `forces_at_rest` left it. The largest is inf where friction wedges, see `friction.indeterminacy`.
    """
    touching = _touching(assembly)
    place = {int(contact): j for j, contact in enumerate(touching)}
    groups = [[place[contact] for contact in group if contact in place] for group in wanted]
    asked = [group for group in groups if group]
    if not asked or not forces.any():
        return [(0.0, 0.0) for _ in wanted]
    H = _balance(assembly, touching.size)
    ranges = iter(force_ranges(H, holding_friction(assembly)[touching], forces[touching].ravel(), asked))
    return [next(ranges) if group else (0.0, 0.0) for group in groups]


def _balance(assembly: Assembly, count: int) -> Array:
    """Return rows, (3 count, n), of what unit contact forces do to bodies in the mass metric, less what joints hold."""
    rows, system, n = assembly.problem.rows, assembly.problem.bilateral, assembly.problem.w.size
    H = np.zeros((3 * count, n))
    effect_on_bodies(rows, np.arange(count), H)
    if not len(system.J):
        return H
    with one_thread():
        J = dense_rows(system.node, system.J[:, None], n)[:, 0]
        return np.asarray(H - (H @ np.linalg.pinv(J)) @ J)
