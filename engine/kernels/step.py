"""One time step of length h: Moreau's theta-method with combined projection (paper, eqs. 20-22)."""

from engine.friction.arrays import CONVERGED
from engine.friction.solver import solve_friction
from engine.jit import inner
from engine.kernels.bilateral import tie_targets
from engine.kernels.broad_phase import look_around, rates, spend
from engine.kernels.joints import hold_joints
from engine.kernels.loads import apply_loads
from engine.kernels.motion import damp, free_twist, keep, move
from engine.kernels.projection import project_positions
from engine.kernels.velocity import (
    first_active_set,
    free_relative_velocities,
    gather,
    grow_active_set,
    scatter,
    worst_contact,
)

GROWTH_ROUNDS = 20


@inner
def step(model, state, work, problem, control, theta, phase, t, h):
    """Advance ``state`` by ``h`` from time ``t``; ``theta``: see `kernels.run`.

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
    watch, held, x, R, n = work.watch, work.held, state.x, state.R, problem.w.shape[0]
    begin, rest, plain = (1 - theta) * h, theta * h, control.plain
    keep(state, work.kept)

    # free motion to within the step, and to its end without contact impulses
    move(state, begin)
    spend(contacts.a, contacts.b, contacts.reach, state.v, begin, watch)
    apply_loads(bodies, model.loads, model.time_laws, state, phase, t + begin, work.wrench, work.a, work.b)
    tie_targets(ties, model.time_laws, t, h, held.target)
    for again in (False, True):
        if not again or held.violation.shape[0] > 0:
            free_twist(bodies, R, state.v, work.wrench, h, theta, again, work.free)
            damp(state.v, work.free, model.phases.damping[phase], h)
            hold_joints(
                bodies, ties, x, R, state.v, work.free, held, h, 1.0 if plain else theta, problem.ties, problem.w
            )

    # impulses at the contacts found there; the active set grows until nothing passes through it
    rates(work.free, watch.rate)
    look_around(contacts, x, R, watch, rest, 0.0, work.gap, work.point, work.frame)
    free_relative_velocities(contacts, laws, state, work, rest, plain)
    first_active_set(laws, watch.near, work.gap, work.q, state.r, rest, plain, work.active)
    status, residual, iterations, fastest = CONVERGED, 0.0, 0, 0.0
    for _ in range(GROWTH_ROUNDS):
        nc = gather(
            bodies, contacts, laws, x, R, state.r, work, problem.rows, problem.mu, problem.q, problem.r
        )  # fmt: skip
        if nc > 0:
            status, spent, residual = solve_friction(n, nc, problem, control.tolerance)
            iterations += spent
        scatter(bodies, work.chosen, nc, problem.r, problem.u, problem.w, work.free, state)
        if status != CONVERGED:
            where = worst_contact(problem.mu, problem.r, problem.u, problem.scale, work.chosen, nc)
            return status, residual, 0.0, where, 0.0, fastest, iterations
        added, fastest = grow_active_set(contacts, laws, state, work, rest)
        if added == 0 or plain:
            break

    # the rest of the displacement, out of what violation the linearisation left, and twists that fit the joints there
    move(state, rest)
    spend(contacts.a, contacts.b, contacts.reach, state.v, rest, watch)
    worst, where, off = project_positions(
        bodies, contacts, ties, state, work, problem, control.penetration, control.violation
    )
    if not plain:
        hold_joints(bodies, ties, x, R, state.v, state.v, held, 0.0, theta, problem.ties, problem.w)
    return status, residual, worst, where, off, fastest, iterations
