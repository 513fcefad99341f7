"""One time step of length h: Moreau's theta-method with combined projection (paper, eqs. 20-22).

A step is a sequence of stages, each a kernel in its own module. All stages read and write the tuples of one
`StepContext`.
"""

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED
from engine.friction.solver import solve_friction
from engine.jit import inner
from engine.kernels.bilateral import add_contact_part, find_redundant_rows, finish_bushings, hold_joints, row_targets
from engine.kernels.broad_phase import body_speeds, consume_budget, find_near_contacts
from engine.kernels.compliance import bend, compress, soften
from engine.kernels.energy import work_of_contacts
from engine.kernels.loads import apply_loads
from engine.kernels.model import StepResult
from engine.kernels.motion import damp, fastest_body, fastest_spin, free_twist, impulse_time, move, save_start
from engine.kernels.projection import project_positions
from engine.kernels.rolling import begin_rolling, match_rolling
from engine.kernels.velocity import (
    apply_impulses,
    first_active_set,
    free_relative_velocities,
    gather_problem,
    grow_active_set,
    look_at_active_contacts,
    worst_contact,
)

GROWTH_ROUNDS = 20
ALONE = 1  # round from which the active set grows by all near contacts; before it, only by those that close


@inner
def step(context):
    """Advance the state by one step of length ``h`` from time ``t``."""
    model, state, work, problem, control, phase, t, h, theta, bounce = context
    bodies, contacts, laws, bilateral = model.bodies, model.contacts, model.laws, model.bilateral
    bushings, time = model.loads.bushings, impulse_time(model.phases.damping[phase], h)
    before, after, plain = (1 - theta) * h, theta * h, control.plain  # the impulses act between these two parts
    save_start(state, work.start)
    find_redundant_rows(model.metric, bilateral, state, work.bilateral, problem)

    # free motion to within the step, and the twists at its end without contact impulses; the plain scheme evaluates
    # joints and normals at the end of the step, as reached with the twists at its start
    move(state, before)
    consume_budget(contacts, state.v, before, work.broad_phase)
    apply_loads(bodies, model.loads, model.time_laws, state, phase, t + before, work.wrench, work.vectors)
    row_targets(bilateral, model.time_laws, t, h, work.bilateral.target)
    # joints need a second pass, in which the gyroscopic moment takes their impulses into account, see `free_twist`
    for again in (False, True):
        if not again or work.bilateral.violation.shape[0] > 0:
            free_twist(bodies, state.R, state.v, work.wrench, h, theta, again, work.free)
            damp(state.v, work.free, model.phases.damping[phase], h)
            if plain:
                move(state, after)
            within = h, 1.0 if plain else theta, time
            hold_joints(bodies, bilateral, bushings, state, work.bilateral, problem, work.free, within)
            if plain:
                move(state, -after)

    # impulses at the contacts of that pose; the active set grows until no contact is driven into penetration
    body_speeds(work.free, work.broad_phase.speed)
    find_near_contacts(contacts, state, work.broad_phase, work.sites, after, 0.0, work.gap)
    free_relative_velocities(contacts, laws, state, work, (after, h), plain, bounce)
    first_active_set(laws, state, work, after, plain, bounce)
    begin_rolling(contacts, state, work, time)
    if plain:
        move(state, after)
        look_at_active_contacts(contacts, state, work)
    status, residual, iterations, fastest, spin = CONVERGED, 0.0, 0, 0.0, 0.0
    for growth in range(GROWTH_ROUNDS + 1):
        nc = gather_problem(bodies, contacts, laws, model.time_laws, state, work, problem, time)
        soften(bodies, contacts, state, work, problem, nc, (before, after, time), growth == 0)
        if plain:  # once only: this scheme does not grow its active set
            move(state, -after)
        if nc > 0:
            status, spent, left = solve_friction(nc, problem, control.tolerance)
            iterations += spent
            residual = max(residual, left)
        apply_impulses(bodies, contacts, state, work, problem, nc)
        if status == CONVERGED:
            grown = 0 if plain else grow_active_set(contacts, laws, state, work, (after, h), growth >= ALONE, bounce)
            if grown + bend(contacts, work, problem, nc, after) + match_rolling(contacts, state, work, time) == 0:
                break
            if growth == GROWTH_ROUNDS:
                status = NOT_CONVERGED  # contacts still close, or press more or less, than in the last problem
        if status != CONVERGED:
            contact = worst_contact(problem, work.chosen, nc)
            return StepResult(status, residual, 0.0, contact, 0.0, 0.0, 0.0, 0.0, 0.0, fastest, spin, iterations)
    if bilateral.read[0]:
        add_contact_part(bilateral, work.bilateral, problem, nc, h, model.phases.damping[phase])
    fastest, spin = fastest_body(bodies, state.v), fastest_spin(state.v)
    stored = compress(contacts, work, problem, nc, after, time)
    created, lost = work_of_contacts(bodies, contacts, state, work, problem, nc, theta, plain)
    if bilateral.yielding.shape[0] > 0:
        start, system = work.start.v, problem.bilateral
        lost += finish_bushings(bilateral, bushings, state, work.bilateral, system, start, h, theta)

    # the rest of the displacement, the projection of the positions, and twists consistent with the joints at the new
    # pose
    move(state, after)
    consume_budget(contacts, state.v, after, work.broad_phase)
    penetration, contact, violation, widest, lifted = project_positions(
        bodies, model.metric, contacts, bilateral, state, work, problem, control
    )
    braked, energy = 0.0, created + stored + lifted
    if not plain:
        braked = hold_joints(bodies, bilateral, bushings, state, work.bilateral, problem, state.v, (0.0, theta, 0.0))
    lost += braked - lifted
    braked = braked if np.any(work.bilateral.redundant) else 0.0
    errors = residual, penetration, contact, violation, widest
    return StepResult(status, *errors, energy, lost, braked, fastest, spin, iterations)
