"""Velocity stage: impulses and the twist at the end of the step, with the impact law and Coulomb friction (eq. 21)."""

import numpy as np

from engine.friction.solver import solve_friction
from engine.kernels.contacts import add_whitened, relative_velocity, whitened_rows
from engine.kernels.jit import kernel


@kernel
def free_relative_velocities(model, state, work):
    """Write each contact's relative velocity without impulses, plus the shift its impact law asks for.

    Without restitution a contact may close in the step but not overshoot: u_N + 2 max(g_N, 0)/h >= 0 at mid-step. The
    shift for that is added by `solve_velocities`. With restitution the law is Newton's, u_N + e u_N^- >= 0 (eq. 6).
    """
    for i in range(model.mu.shape[0]):
        relative_velocity(model, state, i, work.point[i], work.frame[i], work.free, work.q0[i])


@kernel
def impact_shift(model, state, work, i, h, u):
    """Return what the normal velocity of contact i may be below zero at most; ``u`` is work space, shape (3,)."""
    if model.restitution[i] > 0.0:
        relative_velocity(model, state, i, work.point[i], work.frame[i], work.before, u)
        return min(model.restitution[i] * u[0], 0.0)
    return max(2 * work.middle_gap[i] / h, 0.0)


@kernel
def first_active_set(model, state, work, h):
    """Activate contacts that pressed in the last step or would pass through each other without an impulse."""
    for i in range(model.mu.shape[0]):
        gap, approach = work.middle_gap[i], 0.5 * h * work.q0[i, 0]
        if model.restitution[i] > 0.0:
            work.active[i] = gap <= 0.0
        else:
            work.active[i] = gap + approach <= 0.0 or (state.r[i, 0] > 0.0 and gap <= 2 * abs(approach))
        if not work.active[i]:
            state.r[i, 0] = state.r[i, 1] = state.r[i, 2] = 0.0


@kernel
def solve_velocities(model, state, work, problem, h, tolerance, u):
    """Solve the friction problem of the active contacts; write impulses to ``state.r``, twists to ``state.v``.

    Returns the solver's status, its iterations and its residual.
    """
    n = 0
    for i in range(model.mu.shape[0]):
        if work.active[i]:
            work.index[n] = i
            problem.count[n] = whitened_rows(
                model, state, i, work.point[i], work.frame[i], problem.column[n], problem.G[n]
            )
            problem.mu[n] = model.mu[i]
            for k in range(3):
                problem.q[n, k] = work.q0[i, k]
                problem.r[n, k] = state.r[i, k]
            problem.q[n, 0] += impact_shift(model, state, work, i, h, u)
            n += 1
    status, iterations, residual = solve_friction(6 * model.mass.shape[0], n, problem, tolerance)
    for j in range(n):
        for k in range(3):
            state.r[work.index[j], k] = problem.r[j, k]
        state.slip[work.index[j]] = np.sqrt(problem.u[j, 1] ** 2 + problem.u[j, 2] ** 2)
    state.v[:] = work.free
    add_whitened(model, problem.w, state.v)
    return status, iterations, residual


@kernel
def grow_active_set(model, state, work, h, u):
    """Activate every contact that the new twists would drive into penetration (eq. 22); return how many."""
    added = 0
    for i in range(model.mu.shape[0]):
        if work.active[i]:
            continue
        relative_velocity(model, state, i, work.point[i], work.frame[i], state.v, u)
        if u[0] < 0.0 and work.middle_gap[i] + 0.5 * h * u[0] < 0.0:
            work.active[i] = True
            added += 1
    return added
