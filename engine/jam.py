"""Why a failed step has no solution: the contacts, joints and motions that squeeze what lies between them."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly import Assembly
from engine.friction.arrays import dense_rows
from engine.friction.infeasibility import squeezing_impulses
from engine.kernels import time_loop
from engine.kernels.bilateral import row_violations, whitened_bilateral_rows
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.contacts import whitened_rows
from engine.kernels.projection import REACH
from engine.platform.linear_algebra import one_thread

SIDES = 32  # of the pyramid that approximates Coulomb's cone from inside
LITTLE = 1e-6  # share of the largest impulse; anything smaller is a rounding error of zero


@dataclass(frozen=True)
class Jam:
    """A proof that a step has no solution; contacts and rows are the numbers of `Assembly`.

    If it is ``locked``, the balance needs friction: theory does not guarantee a solution, and none was found.
    """

    contacts: tuple[int, ...]  # whose impulses balance each other, whatever the bodies do
    rows: tuple[int, ...]  # joints and motions that balance the rest of these impulses, or contradict each other
    locked: bool = False  # whether the bodies could escape without friction


def find_jam(assembly: Assembly, status: int) -> Jam | None:
    """Return why the last step of a failed run has no solution; None if it may have one.

    ``status`` is the final one of `kernels.time_loop`. The friction problem of the assembly is overwritten.
    """
    with one_thread():
        if status == time_loop.NOT_CONVERGED:
            return _jam_of_velocities(assembly)
        if status == time_loop.PENETRATION or status == time_loop.VIOLATION:
            return _jam_of_positions(assembly)
    return None


def _jam_of_velocities(assembly: Assembly) -> Jam | None:
    """Look for normal impulses, else impulses with friction, that balance in the friction problem of the last step."""
    problem, chosen = assembly.problem, assembly.work.chosen[: np.count_nonzero(assembly.work.active)]
    nc = chosen.size
    G, J = _contact_rows(assembly, nc), _bilateral_rows(assembly)
    q, mu = problem.q[:nc], problem.mu[:nc, None]
    speed = float(np.abs(q).max(initial=0.0))
    jam = _squeeze(chosen, G[:, 0], q[:, 0], speed, J)
    if jam is None:  # only now: normal impulses alone are a proof, those with friction just leave no guarantee
        angle = 2 * np.pi * np.arange(SIDES) / SIDES
        edges = np.stack(np.broadcast_arrays(1.0, mu * np.cos(angle), mu * np.sin(angle)), axis=2)
        rows, velocities = (edges @ G).reshape(-1, G.shape[2]), np.einsum("isk,ik->is", edges, q)
        jam = _squeeze(np.repeat(chosen, SIDES), rows, velocities.ravel(), speed, J, locked=True)
    return jam


def _jam_of_positions(assembly: Assembly) -> Jam | None:
    """Look for impulses that no displacement evades, from the gaps and joint violations at the last pose."""
    model, state, work, problem = assembly.model, assembly.state, assembly.work, assembly.problem
    contacts, sites, at_pose = model.contacts, work.sites, work.bilateral
    off, point, direction = at_pose.violation, at_pose.point, at_pose.direction
    find_contacts(contacts, state.x, state.R, state.gap, sites.point, sites.frame)
    row_violations(model.bilateral, state.x, state.R, at_pose.target[1], off, point, direction)
    whitened_bilateral_rows(model.bodies, model.bilateral, state.x, state.R, point, direction, problem.bilateral.J)
    J = _bilateral_rows(assembly)
    worst = float(max(-state.gap.min(initial=0.0), np.abs(off).max(initial=0.0)))
    chosen = np.flatnonzero(state.gap <= REACH * worst)
    for j, i in enumerate(chosen):
        whitened_rows(model.bodies, contacts, state.x, state.R, sites, i, problem.rows, j)
    N = _contact_rows(assembly, chosen.size)[:, 0]
    # each row as two inequalities: what they squeeze is a contradiction between joints and motions
    contradiction = squeezing_impulses(np.vstack([J, -J]), np.concatenate([off, -off]), worst)
    if contradiction is not None:
        pull = contradiction[: len(J)] - contradiction[len(J) :]
        return Jam((), _largest(np.arange(len(J)), np.abs(pull)))
    # contacts are judged after the displacement that closes the joints, as in the projection
    closing = np.linalg.lstsq(J, -off, rcond=None)[0] if len(J) else np.zeros(J.shape[1])
    return _squeeze(chosen, N, state.gap[chosen] + N @ closing, worst, J)


def _squeeze(numbers: Integers, rows: Array, q: Array, speed: float, J: Array, locked: bool = False) -> Jam | None:
    """Return the contacts that squeeze and the bilateral rows that resist them; None if nothing is squeezed."""
    impulses = squeezing_impulses(rows, q, speed, J)
    if impulses is None:
        return None
    length = np.linalg.norm(J, axis=1)
    held = np.zeros(len(J))
    acts = length > 0.0
    if acts.any():
        held[acts] = np.linalg.lstsq((J[acts] / length[acts, None]).T, rows.T @ impulses, rcond=None)[0]
    least = LITTLE * np.max(impulses * np.linalg.norm(rows, axis=1))
    return Jam(_largest(numbers, impulses), tuple(map(int, np.flatnonzero(np.abs(held) > least))), locked)


def _largest(numbers: Integers, impulses: Array) -> tuple[int, ...]:
    """Return the distinct numbers whose impulse is not negligible."""
    return tuple(dict.fromkeys(map(int, numbers[impulses > LITTLE * impulses.max()])))


def _contact_rows(assembly: Assembly, nc: int) -> Array:
    """Return the rows (N, T1, T2) of the friction problem's first ``nc`` contacts, shape (nc, 3, n)."""
    rows = assembly.problem.rows
    return dense_rows(rows.node[:nc], rows.G[:nc], assembly.problem.w.size)


def _bilateral_rows(assembly: Assembly) -> Array:
    """Return the bilateral rows of the friction problem, shape (nt, n)."""
    system = assembly.problem.bilateral
    return dense_rows(system.node, system.J[:, None], assembly.problem.w.size)[:, 0]
