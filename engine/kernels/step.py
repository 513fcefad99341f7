"""One time step of length h: Moreau's theta-method with combined projection (paper, eqs. 20-22)."""

from engine.friction.arrays import CONVERGED
from engine.friction.solver import solve_friction
from engine.kernels.jit import kernel
from engine.kernels.joints import align_velocities, hold_joints
from engine.kernels.loads import apply_loads
from engine.kernels.motion import free_twist, keep, move
from engine.kernels.projection import project_positions
from engine.kernels.ties import tie_targets
from engine.kernels.velocity import (
    first_active_set,
    free_relative_velocities,
    gather,
    grow_active_set,
    scatter,
    worst_contact,
)
from engine.kernels.watch import look_ahead, rates, spend

GROWTH_ROUNDS = 20


@kernel
def step(model, state, work, problem, control, phase, t, h):
    """Advance ``state`` by ``h`` from time ``t``.

    Returns
    -------
    status : of the friction solver
    residual : largest relative residual of the step's friction problems
    worst, where : largest penetration left, and the contact of it, or of the largest residual if not converged
    off : largest joint violation left
    fastest : relative speed of the fastest contact point
    iterations : of the friction solver
    """
    bodies, contacts, laws, ties = model.bodies, model.contacts, model.laws, model.ties
    begin, rest = (1 - control.theta) * h, control.theta * h
    keep(state, work)

    # free motion to within the step, and to its end without contact impulses
    move(state, begin)
    spend(contacts, state.x, state.v, begin, work.rate, work.lever, work.budget)
    apply_loads(bodies, model.loads, state, phase, work.wrench, work.a, work.b)
    free_twist(bodies, state.R, state.v, work.wrench, h, control.theta, work.free)
    tie_targets(ties, model.time_laws, t, h, work.target)
    hold_joints(bodies, ties, state, work, problem, h, 1.0 if control.plain else control.theta)

    # impulses at the contacts found there; the active set grows until nothing passes through it
    rates(state.x, work.free, work.rate)
    look_ahead(contacts, state.x, state.R, work, rest, work.gap)
    free_relative_velocities(contacts, laws, state, work, rest, control.plain)
    first_active_set(laws, work, state.r, rest, control.plain)
    status, residual, iterations, fastest = CONVERGED, 0.0, 0, 0.0
    for _ in range(GROWTH_ROUNDS):
        n = gather(bodies, contacts, laws, state, work, problem)
        if n > 0:
            status, spent, residual = solve_friction(problem.w.shape[0], n, problem, control.tolerance)
            iterations += spent
        scatter(bodies, state, work, n, problem)
        if status != CONVERGED:
            where = worst_contact(problem.mu, problem.r, problem.u, problem.scale, work.chosen, n)
            return status, residual, 0.0, where, 0.0, fastest, iterations
        added, fastest = grow_active_set(contacts, laws, state, work, rest)
        if added == 0 or control.plain:
            break

    # the rest of the displacement, out of what violation the linearisation left, and twists that fit the joints there
    move(state, rest)
    spend(contacts, state.x, state.v, rest, work.rate, work.lever, work.budget)
    worst, where, off = project_positions(
        bodies, contacts, ties, state, work, problem, control.penetration, control.violation
    )
    if not control.plain:
        align_velocities(bodies, ties, state, work, problem)
    return status, residual, worst, where, off, fastest, iterations
