"""Contact forces at rest: of all balanced forces, those of equally stiff contacts.

When all contacts stick, the forces are not unique: friction at redundant contacts may hold any of a continuum.
Those reported are the limit of contacts that are all equally, and hardly, compliant, u = -c r. They follow from the
pose alone, not from its history. Ideal joints and prescribed motions hold any load.
"""

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly import Assembly
from engine.friction.arrays import dense_rows
from engine.friction.indeterminacy import force_ranges
from engine.kernels.statics import HELD, effect_on_bodies, hold_loads
from engine.linear_algebra import one_thread


def forces_at_rest(assembly: Assembly, phase: int, h: float, touching_gap: float, t: float = 0.0) -> Array | None:
    """Return the contact forces that hold the loads of ``phase`` and time ``t`` at the present pose.

    Parameters
    ----------
    assembly : Assembly
        The mechanism, at rest; its twists are set to zero, and its friction problem is changed.
    phase : int
        Number of the phase whose forces and torques act.
    h : float
        Any time; the forces are the impulses in a small share of it, divided by its length.
    touching_gap : float
        Contacts open by no more than this length touch; so do those that carried a load in the last step.
    t : float
        Time since the start of the run, for loads with a time law.

    Returns
    -------
    (nc, 3) array or None
        Forces (N, T1, T2). None if the contacts that touch cannot hold the loads: the twists of the bodies are then
        those with which they begin to move, of any size, or zero if the forces were not found.
    """
    h *= 1e-3  # so short that the free motion of an unloaded step has no gyroscopic part
    status, nc = hold_loads(assembly.arrays, phase, t, h, touching_gap)
    if status != HELD:
        return None
    touching, forces = assembly.work.chosen[:nc], np.zeros_like(assembly.state.r)
    forces[touching] = assembly.work.u[touching] / h
    return forces


def normal_force_ranges(assembly: Assembly, forces: Array, wanted: list[int]) -> list[tuple[float, float]]:
    """Return the least and the largest normal force of some contacts among all forces with the same balance.

    Parameters
    ----------
    assembly : Assembly
        At rest, with the friction problem as `forces_at_rest` left it.
    forces : (nc, 3) array
        As `forces_at_rest` returned them.
    wanted : list of int
        Numbers of the contacts.

    Returns
    -------
    list of (least, largest)
        The largest is inf where friction wedges: see `engine.friction.indeterminacy`.
    """
    pressed = np.flatnonzero(forces[:, 0] > 0)
    place = {int(contact): j for j, contact in enumerate(pressed)}
    asked = [place[contact] for contact in wanted if contact in place]
    if not asked:
        return [(0.0, 0.0) for _ in wanted]
    rows = (assembly.work.chosen == pressed[:, None]).argmax(axis=1)  # where the problem has them: it is in order
    H = _balance(assembly, rows)
    ranges = iter(force_ranges(H, assembly.model.laws.mu[pressed], forces[pressed].ravel(), asked))
    return [next(ranges) if contact in place else (0.0, 0.0) for contact in wanted]


def _balance(assembly: Assembly, chosen: Integers) -> Array:
    """Return the effect on the bodies of forces at some contacts of the friction problem, less what joints hold.

    Rows (N, T1, T2) each, shape (3 contacts, n), in the mass metric.
    """
    rows, system, n = assembly.problem.rows, assembly.problem.bilateral, assembly.problem.w.size
    H = np.zeros((3 * chosen.size, n))
    effect_on_bodies(rows, chosen, H)
    if not len(system.J):
        return H
    with one_thread():
        J = dense_rows(system.node, system.J[:, None], n)[:, 0]
        return np.asarray(H - (H @ np.linalg.pinv(J)) @ J)
