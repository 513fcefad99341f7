"""One time step of length h: Moreau's midpoint rule with combined projection (paper, eqs. 20-22)."""

from engine.friction.arrays import CONVERGED
from engine.friction.solver import solve_friction
from engine.kernels.gaps import find_contacts
from engine.kernels.jit import kernel
from engine.kernels.loads import apply_loads
from engine.kernels.motion import free_twist, move
from engine.kernels.projection import ROUNDS, TOLERANCE, displace, gather_projection, worst_penetration
from engine.kernels.velocity import (
    first_active_set,
    free_relative_velocities,
    gather,
    grow_active_set,
    scatter,
)

GROWTH_ROUNDS = 20


@kernel
def step(model, state, work, problem, phase, h, tolerance, penetration):
    """Advance ``state`` by ``h``.

    Returns
    -------
    status : of the friction solver
    residual : largest relative residual of the step's friction problems
    worst, where : largest penetration left, and its contact
    iterations : of the friction solver
    """
    bodies, contacts, laws = model.bodies, model.contacts, model.laws
    velocities = 6 * bodies.mass.shape[0]

    # free motion to mid-step, and to the end of the step without impulses
    move(state, 0.5 * h)
    apply_loads(bodies, model.loads, model.time_laws, state, phase, 0.0, work.wrench, work.a, work.b)
    free_twist(bodies, state.R, state.v, work.wrench, h, work.free)

    # impulses at the contacts found at mid-step; the active set grows until nothing passes through it
    find_contacts(contacts, state.x, state.R, work.gap, work.point, work.frame)
    free_relative_velocities(contacts, laws, state, work, h)
    first_active_set(laws, work, state.r, h)
    status, residual, iterations = CONVERGED, 0.0, 0
    for _ in range(GROWTH_ROUNDS):
        n = gather(bodies, contacts, laws, state, work, problem)
        status, spent, residual = solve_friction(velocities, n, problem, tolerance)
        iterations += spent
        scatter(bodies, state, work, n, problem)
        if status != CONVERGED or grow_active_set(contacts, state, work, h) == 0:
            break

    # the second half of the displacement, and out of what penetration the linearisation left
    move(state, 0.5 * h)
    worst, where = 0.0, -1
    for _ in range(ROUNDS):
        find_contacts(contacts, state.x, state.R, state.gap, work.point, work.frame)
        worst, where = worst_penetration(state.gap)
        if worst <= 0.5 * penetration or not worst < 1e300:
            break
        n = gather_projection(bodies, contacts, state, work, worst, problem)
        solved, _, _ = solve_friction(velocities, n, problem, TOLERANCE)
        if solved != CONVERGED:
            break
        displace(bodies, state, work, problem.w)
    return status, residual, worst, where, iterations
