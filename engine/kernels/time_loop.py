"""The whole time loop of a run in one compiled call: phases, steps, rest, certificate."""

from typing import NamedTuple

import numpy as np

from engine.friction.arrays import CONVERGED
from engine.jit import by_address, inner, kernel
from engine.kernels.bilateral import begin_rows, read_motions, some_motion_goes_on
from engine.kernels.energy import kinetic_energy
from engine.kernels.impacts import largest_impact
from engine.kernels.model import (
    BOUNCES,
    CONTACT_FORCE,
    CONTACT_IMPULSE,
    DERIVED,
    END,
    FRICTION_WORK,
    IMPULSE,
    MEAN,
    MOTION_WORK,
    Control,
    StepContext,
)
from engine.kernels.motion import impulse_time, restore_start
from engine.kernels.record import record
from engine.kernels.responses import accumulate, measure, update_reported
from engine.kernels.rest import moved, slow, start_pause
from engine.kernels.step import step
from engine.run import LARGEST_TURN

HALVINGS = 4
CREATED = 1e-3  # share of the largest kinetic energy so far that a step may create, or closed loops remove
LESS_BOUNCE, LEAST_BOUNCE = 0.8, 0.1  # factor of the restitution of a step that creates more; below the second, none
MUCH_CREATED = 0.1  # share of it that all steps together may create before the longest step is halved
ROUNDING = 1e-6  # share of a step by which the sum of all steps may be off

OK, NOT_CONVERGED, PENETRATION, VIOLATION, DIVERGED, STOPPED, FULL, PHASE_OVER, RELEASED = range(9)

# indices of `Course.counts`
STATUS, PHASE, STEPS, ITERATIONS, REPEATED, CONTACT = range(6)
SETTLED, COMPLETED, STOPPED_BY, ACCEPTED, SLOW, SHORTENED, BALANCED = range(6, 13)
# indices of `Course.reals`
TIME, STEP, MAX_RESIDUAL, MAX_PENETRATION, MAX_VIOLATION = range(5)
PAUSE, PHASE_END, FASTEST, LONGEST, SLOW_TIME = range(5, 10)
MOST_CREATED, ALL_CREATED, PEAK_KINETIC, LATELY_CREATED = range(10, 14)
MOST_LOST, ALL_LOST, SPIN, MOST_TURN = range(14, 18)

PATIENCE = 3  # windows of rest: a mechanism that is slow for this long without coming to rest gets shorter steps


@by_address
class Course(NamedTuple):
    """The progress of a run and its certificate; the loop continues from here when it is called again."""

    # (13,) int64. STEPS: all steps tried; ACCEPTED: those that count; CONTACT: the worst one of the last step;
    # SLOW: whether all bodies were slow at the end of the last step; SHORTENED: whether it was repeated; BALANCED: the
    # last phase at whose end the forces at rest were determined
    counts: np.ndarray
    # (18,). FASTEST: speed of the fastest body in the last step, see `motion.fastest_body`; LONGEST: longest step
    # currently allowed in the phase; SLOW_TIME: simulated time spent slow with it; PAUSE: time for which nothing has
    # moved, -1 before a phase's first step; MOST_CREATED, ALL_CREATED: energy created by one step, and by all steps;
    # PEAK_KINETIC: largest kinetic energy so far, at least that of all bodies at the speed that counts as slow;
    # LATELY_CREATED: energy created by steps since LONGEST was set; MOST_LOST, ALL_LOST: the same of energy that is
    # lost; SPIN: largest angular speed at the end of the last step; MOST_TURN: largest rotation of a body in a step
    reals: np.ndarray


def new_course(control: Control) -> Course:
    """Return the course of a run that has not begun."""
    counts, reals = np.zeros(13, np.int64), np.zeros(18)
    # as no speed is known yet, an infinite one makes the first step the shortest
    counts[PHASE] = counts[BALANCED] = -1
    reals[STEP], reals[FASTEST] = control.step, np.inf
    return Course(counts, reals)


@kernel
def run_to_end(arrays, control, course, rows, every, stop):
    """Simulate until rest in the last phase, the horizon, or a failure, from the progress in ``course``.

    A step whose friction problem or projection is not solved is repeated with half its length, ``HALVINGS`` times and
    down to that many halvings of the shortest step. So is a step that creates more than ``CREATED`` of the largest
    kinetic energy so far, or in which a closed loop of joints brakes its own motion by as much, except in the plain
    scheme. If even the shortest such step creates it, it is repeated with less restitution, down to none, and is then
    accepted.

    Every ``every``-th step (0: none) is written into ``rows``, see `kernels.record`. When they are full, the status is
    FULL, and the run continues when it is called again with room in them. With ``control.pauses`` the status is
    PHASE_OVER at rest at the end of a phase before the last, if forces are read there, and the run goes on when its
    number is BALANCED; it is RELEASED where a later phase begins with no body moving. ``stop``, (1,) uint8, is set by
    another thread to end the run (time limit, cancellation).
    """
    model, state, work, _ = arrays
    n, now, phases = course.counts, course.reals, model.phases.duration.shape[0]
    restitution = 0.0
    for i in range(model.laws.restitution.shape[0]):
        restitution = max(restitution, model.laws.restitution[i])
    hits, adds = _reads_forces_in_motion(model.responses), _adds_up(model.responses)
    n[STATUS] = OK
    if n[PHASE] < 0:
        now[PEAK_KINETIC] = 0.5 * np.sum(model.bodies.mass) * control.slow**2
        _next_phase(model, state, work, control, course)
        _measure(model, state, work, course)
    while n[PHASE] < phases:
        open_end = model.phases.duration[n[PHASE]] == np.inf
        until_rest = open_end and model.phases.trigger[n[PHASE]] < 0
        stay = not until_rest or (control.full_horizon and n[PHASE] == phases - 1)
        ended = _event_happened(model.phases, n[PHASE], work.values) or (n[SETTLED] == 1 and not stay)
        if ended or not now[TIME] < now[PHASE_END] - 0.5 * control.step:
            if open_end and not ended and not (until_rest and n[SETTLED] == 1):
                return
            pauses = control.pauses and n[SETTLED] == 1 and n[BALANCED] != n[PHASE] and n[PHASE] < phases - 1
            if pauses and _reads_forces(model.responses, n[PHASE]):
                n[STATUS] = PHASE_OVER
                return
            _next_phase(model, state, work, control, course)
            at_rest = slow(model.bodies, state.v, control.drift / control.window)
            if control.pauses and at_rest and n[PHASE] < phases:
                n[STATUS] = RELEASED
                return
            continue
        if every > 0 and n[ACCEPTED] % every == 0 and record(model, state, work, now[TIME], now[STEP], rows):
            n[STATUS] = FULL
            return
        before = now[STEP]
        now[STEP] = _next_step_length(control, course)
        theta = 1.0 if n[SLOW] != 0 else control.theta
        rate = model.phases.damping[n[PHASE]]
        _scale_impulses(state.r, impulse_time(rate, now[STEP]) / before)
        _advance(arrays, control, course, theta, 1.0 if restitution > 0.0 and n[SLOW] == 0 else 0.0)
        _scale_impulses(state.r, now[STEP] / impulse_time(rate, now[STEP]))  # forces act during the whole step
        n[ACCEPTED] += 1
        if n[STATUS] == OK and stop[0] != 0:
            n[STATUS], n[STOPPED_BY] = STOPPED, stop[0]
        if n[STATUS] != OK:
            return
        if model.bilateral.read[0]:
            read_motions(model.bilateral, model.time_laws, work.bilateral, now[TIME], now[STEP])
        _measure(model, state, work, course)
        if adds:
            accumulate(model, state, work, now[TIME], now[STEP])
        if hits:
            work.impact[1] = work.impact[0]
            work.impact[0] = largest_impact(model.bodies, model.contacts, state, work) / now[STEP]
        update_reported(model.responses, work, n[PHASE], now[STEP])
        _track_rest(model, state, work, control, course)
        if until_rest and slow(model.bodies, state.v, control.slow):
            n[SLOW] = 1
            _shorten_longest_step(control, now)
        else:
            n[SLOW] = 0
        if not control.plain and now[LATELY_CREATED] > MUCH_CREATED * now[PEAK_KINETIC]:
            _halve_longest_step(control, now)
    n[PHASE] = phases - 1  # whose loads the forces at rest balance
    n[COMPLETED] = 1


@inner
def _measure(model, state, work, course):
    """Measure all responses at the end of a step."""
    for i in range(work.values.shape[0]):
        work.previous[i] = work.values[i]
    instant = course.reals[TIME], course.reals[STEP]
    measure(model, state, work.sites, work.bilateral, work.values, work.vectors, instant)


@inner
def _next_phase(model, state, work, control, course):
    """Enter the next phase: its clock and its motions begin."""
    n, now = course.counts, course.reals
    n[PHASE] += 1
    for i in range(work.values.shape[0]):  # a sum or count begins with the phase with which it begins
        adds_up = model.responses.kind[i] in (CONTACT_IMPULSE, MOTION_WORK, IMPULSE, BOUNCES, FRICTION_WORK)
        if adds_up and model.responses.from_phase[i] == n[PHASE]:
            work.values[i], work.touched[i] = 0.0, False
    if n[PHASE] < model.phases.duration.shape[0]:
        model.time_laws.begun[n[PHASE]] = now[TIME]
        begin_rows(model.bilateral, state, work.bilateral, n[PHASE])
        now[PHASE_END] = min(now[TIME] + model.phases.duration[n[PHASE]], control.horizon)
        now[PAUSE], n[SETTLED], n[SLOW] = -1.0, 0, 0
        now[LONGEST], now[SLOW_TIME], now[LATELY_CREATED] = control.longest, 0.0, 0.0


@inner
def _reads_forces(responses, phase):
    """Return whether contact forces are read at the end of a phase, or may be at the beginning of the next one."""
    for i in range(responses.kind.shape[0]):
        force = responses.kind[i] >= CONTACT_FORCE or responses.kind[responses.trigger[i]] >= CONTACT_FORCE
        at_end = responses.at[i] == END and responses.to_phase[i] == phase
        if force and (at_end or responses.from_phase[i] == phase + 1):
            return True
    return False


@inner
def _reads_forces_in_motion(responses):
    """Return whether a force of a single step is read."""
    for i in range(responses.kind.shape[0]):
        kind = max(responses.kind[i], responses.kind[responses.trigger[i]])
        if kind >= CONTACT_FORCE and kind != DERIVED:
            return True
    return False


@inner
def _adds_up(responses):
    """Return whether an impulse, a mean, a count or friction's work is read, see `kernels.responses.accumulate`."""
    found = False
    for i in range(responses.kind.shape[0]):
        found = found or responses.kind[i] in (IMPULSE, MEAN, BOUNCES, FRICTION_WORK)
    return found


@inner
def _event_happened(phases, phase, values):
    """Return whether the event that ends a phase has happened."""
    j = phases.trigger[phase]
    return j >= 0 and phases.limit[phase, 1] * (values[j] - phases.limit[phase, 0]) > 0.0


@inner
def _next_step_length(control, course):
    """Return the length of the next step.

    It is at most twice the previous one, and is halved until no body moves or turns too far in it. The last step of a
    phase ends with the phase: a remainder of less than half a step is added to it.
    """
    n, now = course.counts, course.reals
    h = now[STEP] if n[SHORTENED] != 0 else 2 * now[STEP]
    h = min(h, now[LONGEST])
    while h > control.step and (h * now[FASTEST] > control.travel or h * now[SPIN] > LARGEST_TURN):
        h = max(0.5 * h, control.step)
    left = now[PHASE_END] - now[TIME]
    return left if ROUNDING * control.step < left - h < 0.5 * control.step else min(h, left)


@inner
def _advance(arrays, control, course, theta, bounce):
    """Make one step, repeated with half its length while it is not solved or creates energy, and judge it.

    Newton's impact law with friction can create energy however short the step is (Kane's paradox). In that case the
    factor ``bounce`` of the coefficients of restitution is reduced.
    """
    model, state, work, problem = arrays
    n, now, attempt, halved, shortest = course.counts, course.reals, 0, 0, 0.5**HALVINGS * control.step
    endless = 0.5**HALVINGS * shortest
    n[SHORTENED] = 0
    peak = max(now[PEAK_KINETIC], kinetic_energy(model.bodies, state.v))
    while True:
        done = step(StepContext(model, state, work, problem, control, n[PHASE], now[TIME], now[STEP], theta, bounce))
        n[STEPS] += 1
        n[ITERATIONS] += done.iterations
        now[FASTEST], now[SPIN] = done.speed, done.spin
        now[PEAK_KINETIC] = max(peak, kinetic_energy(model.bodies, state.v))
        within = done.penetration <= control.penetration and done.violation <= control.violation
        solved = done.status == CONVERGED and within
        share, last = CREATED * now[PEAK_KINETIC], now[STEP] < 1.5 * shortest
        created_little = control.plain or done.created <= share or (last and bounce == 0.0)
        if solved and created_little and (control.plain or done.braked <= share or last):
            break
        n[REPEATED] += 1
        n[SHORTENED] = 1
        attempt += 1
        # a step that is not solved is halved HALVINGS times, or down to ``shortest``, but not below ``endless``:
        # where a contact closes permanently, ever shorter steps would stop just short of it, without end
        if now[STEP] >= 1.5 * (shortest if solved or attempt > HALVINGS else endless):
            now[STEP] *= 0.5
            halved += 1
        elif solved:
            bounce = LESS_BOUNCE * bounce if bounce > LEAST_BOUNCE else 0.0
        else:
            break
        restore_start(state, work)
        _scale_impulses(state.r, 0.5**halved)
    now[TIME] += now[STEP]
    now[MAX_RESIDUAL] = max(done.residual, now[MAX_RESIDUAL])
    now[MAX_PENETRATION] = max(done.penetration, now[MAX_PENETRATION])
    now[MAX_VIOLATION] = max(done.widest, now[MAX_VIOLATION])
    now[MOST_CREATED] = max(done.created, now[MOST_CREATED])
    now[ALL_CREATED] += max(done.created, 0.0)
    now[LATELY_CREATED] += max(done.created, 0.0)
    now[MOST_LOST] = max(done.lost, now[MOST_LOST])
    now[ALL_LOST] += max(done.lost, 0.0)
    now[MOST_TURN] = max(now[STEP] * done.spin, now[MOST_TURN])
    n[CONTACT] = done.contact
    n[STATUS] = _status(done, control, state.v, now[STEP])


@inner
def _status(done, control, v, h):
    """Return the status of a run after a step of length ``h``."""
    if not _finite(v) or not done.penetration < np.inf or h * done.speed > control.lost:
        return DIVERGED
    if done.status != CONVERGED:
        return NOT_CONVERGED
    if not done.penetration <= control.penetration:
        return PENETRATION
    if not done.violation <= control.violation:
        return VIOLATION
    return OK


@inner
def _finite(v):
    """Return whether all twists are finite numbers."""
    for body in range(v.shape[0]):
        for k in range(6):
            if not abs(v[body, k]) < np.inf:
                return False
    return True


@inner
def _shorten_longest_step(control, now):
    """Halve the longest step of the phase if all bodies stay slow with it without coming to rest."""
    now[SLOW_TIME] += now[STEP]
    if now[SLOW_TIME] > PATIENCE * control.window and now[LONGEST] > control.step:
        _halve_longest_step(control, now)


@inner
def _halve_longest_step(control, now):
    """Halve the longest step of the phase, but not below the shortest, and reset the observations made with it."""
    now[LONGEST] = max(0.5 * now[LONGEST], control.step)
    now[SLOW_TIME] = now[LATELY_CREATED] = 0.0


@inner
def _scale_impulses(r, factor):
    """Convert the last step's impulses to an initial guess for a step of another length."""
    if factor != 1.0:
        for i in range(r.shape[0]):
            for k in range(3):
                r[i, k] *= factor


@inner
def _track_rest(model, state, work, control, course):
    """Update the time for which nothing that matters has moved, nor will a motion whose force or work is read."""
    n, now, rows = course.counts, course.reals, model.bilateral
    unmoved = not moved(
        model.responses, model.contacts.bound, state, work, model.loads.bushings, now[STEP], control.drift
    )
    if rows.read[0] and some_motion_goes_on(rows, model.time_laws, now[TIME]):
        unmoved = False
    now[PAUSE] = now[PAUSE] + now[STEP] if unmoved and now[PAUSE] >= 0.0 else 0.0
    if now[PAUSE] == 0.0:
        start_pause(work.values, work.anchor, work.travel, model.loads.bushings)
    n[SETTLED] = 1 if now[PAUSE] >= control.window else 0
