"""One time step of length h: Moreau's midpoint rule with combined projection (paper, eqs. 20-22)."""

from engine.friction.arrays import CONVERGED
from engine.kernels.contacts import find_contacts
from engine.kernels.jit import kernel
from engine.kernels.loads import apply_loads
from engine.kernels.motion import free_twist, move
from engine.kernels.projection import project_positions
from engine.kernels.velocity import (
    first_active_set,
    free_relative_velocities,
    grow_active_set,
    solve_velocities,
)

GROWTH_ROUNDS = 20


@kernel
def step(model, state, work, problem, phase, h, tolerance, penetration, u):
    """Advance ``state`` by ``h``.

    Returns
    -------
    status : of the friction solver
    residual : largest relative residual of the step's friction problems
    worst, where : largest penetration left, and its contact
    iterations : of the friction solver
    """
    work.before[:] = state.v
    move(model, state, 0.5 * h)
    apply_loads(model, state, phase, work.wrench, u, work.point[0])
    free_twist(model, state, work.wrench, h, work.free)
    find_contacts(model, state, work.middle_gap, work.point, work.frame)
    free_relative_velocities(model, state, work)
    first_active_set(model, state, work, h)
    status, residual, iterations = CONVERGED, 0.0, 0
    for _ in range(GROWTH_ROUNDS):
        status, spent, residual = solve_velocities(model, state, work, problem, h, tolerance, u)
        iterations += spent
        if status != CONVERGED or grow_active_set(model, state, work, h, u) == 0:
            break
    move(model, state, 0.5 * h)
    worst, where = project_positions(model, state, work, problem, penetration)
    return status, residual, worst, where, iterations
