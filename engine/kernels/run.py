"""The whole time loop of a run in one compiled call: phases, steps, rest, certificate."""

from typing import NamedTuple

import numpy as np

from engine.friction.arrays import CONVERGED
from engine.jit import inner, kernel
from engine.kernels.bilateral import begin_ties
from engine.kernels.motion import impulse_time, restore
from engine.kernels.record import record
from engine.kernels.responses import measure, note
from engine.kernels.rest import moved, slow, start_pause
from engine.kernels.step import step

HALVINGS = 4

OK, NOT_CONVERGED, PENETRATION, VIOLATION, DIVERGED, STOPPED, FULL = range(7)

# what `Course.counts` and `Course.reals` hold
STATUS, PHASE, STEPS, ITERATIONS, REPEATED, CONTACT, SETTLED, COMPLETED, STOPPED_BY, MADE, SLOW, MISSED = range(12)
TIME, STEP, RESIDUAL, WORST, OFF, PAUSE, PHASE_END, FASTEST, LONGEST, CALM = range(10)

PATIENCE = 3  # windows of rest: nearly still for so long and not at rest, a mechanism gets shorter steps


class Control(NamedTuple):
    """Settings of a run; lengths and times in the mechanism's units."""

    step: float  # the shortest, and the only one unless longest is larger
    longest: float  # longest step
    travel: float  # the step doubles while no contact point moves farther than this in one
    theta: float  # share of the step after the instant of loads and contacts
    slow: float  # theta is 1 while no body is faster, in a phase that ends at rest
    plain: bool  # Moreau-Jean's scheme without projection
    horizon: float  # longest simulated time
    tolerance: float  # relative residual of every friction problem
    penetration: float  # largest gap violation after a step
    violation: float  # largest violation of an ideal joint or prescribed motion after a step
    window: float  # nothing measured moves for so long: at rest
    drift: float  # what a length may move meanwhile and count as unmoved
    full_horizon: bool  # go on to the horizon even at rest


class Course(NamedTuple):
    """Where a run is, and what it proves of itself; the loop goes on from here when called again."""

    counts: np.ndarray  # (12,) int64, see above; MADE: steps that count; SLOW, MISSED: the last one ended so, began so
    reals: np.ndarray  # (10,); WORST penetration, OFF: violation of a joint, FASTEST contact point, LONGEST step of
    # the phase as yet, CALM: time spent slow with it


def new_course(control: Control) -> Course:
    """Return the course of a run that has not begun."""
    counts, reals = np.zeros(12, np.int64), np.zeros(10)
    counts[PHASE], reals[STEP], reals[FASTEST] = -1, control.step, np.inf
    return Course(counts, reals)


@kernel
def run(model, state, work, problem, control, course, rows, every, stop):
    """Simulate until rest in the last phase, or the horizon, or a failure.

    A step whose friction problem or projection is not solved is repeated with half its length, ``HALVINGS`` times and
    down to that many halvings of the shortest step. Every ``every``-th step is written into ``rows`` (see
    `kernels.record`; 0: none); when they are full the status is FULL, and the run goes on when called again with
    room in them.

    ``stop``, shape (1,) uint8, is set from another thread to end the run (time limit, cancel).
    """
    n, now = course.counts, course.reals
    n[STATUS] = OK
    phases = model.phases.duration.shape[0]
    if n[PHASE] < 0:
        _next_phase(model, state, work.held, control, n, now)
        _measure(model, state, work, now[TIME], now[STEP])
    while n[PHASE] < phases:
        open_end = model.phases.duration[n[PHASE]] == np.inf
        until_rest = open_end and model.phases.trigger[n[PHASE]] < 0
        stay = not until_rest or (control.full_horizon and n[PHASE] == phases - 1)
        ended = _event(model.phases, n[PHASE], work.values) or (n[SETTLED] == 1 and not stay)
        if ended or not now[TIME] < now[PHASE_END] - 0.5 * control.step:
            if open_end and not ended and not (until_rest and n[SETTLED] == 1):
                return
            _next_phase(model, state, work.held, control, n, now)
            continue
        if every > 0 and n[MADE] % every == 0 and record(model, state, work, now[TIME], now[STEP], rows):
            n[STATUS] = FULL
            return
        before = now[STEP]
        most = before if n[MISSED] != 0 else 2 * before
        most = min(most, now[LONGEST])
        now[STEP] = min(_next_step(most, now[FASTEST], control), now[PHASE_END] - now[TIME])
        theta = 1.0 if n[SLOW] != 0 else control.theta
        rate = model.phases.damping[n[PHASE]]
        _scale_impulses(state.r, impulse_time(rate, now[STEP]) / before)
        _advance(model, state, work, problem, control, theta, n, now)
        _scale_impulses(state.r, now[STEP] / impulse_time(rate, now[STEP]))  # forces act for the whole step
        n[MADE] += 1
        if n[STATUS] == OK and stop[0] != 0:
            n[STATUS], n[STOPPED_BY] = STOPPED, stop[0]
        if n[STATUS] != OK:
            return
        _measure(model, state, work, now[TIME], now[STEP])
        note(model.responses, work.values, work.previous, n[PHASE], work.reported, work.peak)
        _rest(model.responses.measures_motion, state.r, state.slip, work, control, n, now)
        if until_rest and slow(model.bodies, state.v, control.slow):
            n[SLOW] = 1
            _lose_patience(control, now)
        else:
            n[SLOW] = 0
    n[PHASE] = phases - 1
    n[COMPLETED] = 1


@inner
def _measure(model, state, work, t, h):
    """Measure everything at the end of a step."""
    for i in range(work.values.shape[0]):
        work.previous[i] = work.values[i]
    measure(
        model.responses, model.contacts, model.loads, state, work.point, work.frame, t, h, work.values, work.a, work.b
    )


@inner
def _next_phase(model, state, held, control, n, now):
    """Enter the next phase: its clock, its motions."""
    n[PHASE] += 1
    if n[PHASE] < model.phases.duration.shape[0]:
        model.time_laws.begun[n[PHASE]] = now[TIME]
        begin_ties(model.ties, state.x, state.R, held.target[1], held.violation, held.point, held.way, n[PHASE])
        now[PHASE_END] = min(now[TIME] + model.phases.duration[n[PHASE]], control.horizon)
        now[PAUSE], n[SETTLED], n[SLOW] = -1.0, 0, 0
        now[LONGEST], now[CALM] = control.longest, 0.0


@inner
def _event(phases, phase, values):
    """Say whether the event has happened that ends a phase."""
    j = phases.trigger[phase]
    return j >= 0 and phases.limit[phase, 1] * (values[j] - phases.limit[phase, 0]) > 0.0


@inner
def _advance(model, state, work, problem, control, theta, n, now):
    """Make one step, with half its length again and again if it is not solved, and judge it."""
    status, residual, worst, where, off = CONVERGED, 0.0, 0.0, -1, 0.0
    n[MISSED] = 0
    attempt, shortest = 0, 0.5**HALVINGS * control.step
    while True:
        status, residual, worst, where, off, fastest, iterations = step(
            model, state, work, problem, control, theta, n[PHASE], now[TIME], now[STEP]
        )
        n[STEPS] += 1
        n[ITERATIONS] += iterations
        now[FASTEST] = fastest
        if status == CONVERGED and worst <= control.penetration and off <= control.violation:
            break
        n[REPEATED] += 1
        n[MISSED] = 1
        attempt += 1
        if attempt > HALVINGS and now[STEP] < 1.5 * shortest:
            break
        now[STEP] *= 0.5
        restore(state, work.kept, work.watch.budget)
        _scale_impulses(state.r, 0.5**attempt)
    now[TIME] += now[STEP]
    now[RESIDUAL], now[WORST], now[OFF] = max(residual, now[RESIDUAL]), max(worst, now[WORST]), max(off, now[OFF])
    n[CONTACT] = where
    n[STATUS] = OK
    if not _finite(state.v) or not worst < np.inf:
        n[STATUS] = DIVERGED
    elif status != CONVERGED:
        n[STATUS] = NOT_CONVERGED
    elif not worst <= control.penetration:
        n[STATUS] = PENETRATION
    elif not off <= control.violation:
        n[STATUS] = VIOLATION


@inner
def _finite(v):
    """Say whether all twists are finite numbers."""
    for body in range(v.shape[0]):
        for k in range(6):
            if not abs(v[body, k]) < np.inf:
                return False
    return True


@inner
def _next_step(most, speed, control):
    """Return the next step: at most ``most``, and halved until the fastest contact point moves little enough in it."""
    h = most
    while h > control.step and h * speed > control.travel:
        h = max(0.5 * h, control.step)
    return h


@inner
def _lose_patience(control, now):
    """Halve the longest step of the phase when all is slow again and again and does not come to rest with it."""
    now[CALM] += now[STEP]
    if now[CALM] > PATIENCE * control.window and now[LONGEST] > control.step:
        now[LONGEST], now[CALM] = max(0.5 * now[LONGEST], control.step), 0.0


@inner
def _scale_impulses(r, factor):
    """Turn the last step's impulses into a guess for a step of another length."""
    if factor != 1.0:
        for i in range(r.shape[0]):
            for k in range(3):
                r[i, k] *= factor


@inner
def _rest(counts, r, slip, work, control, n, now):
    """Measure how long nothing has moved that matters."""
    unmoved = not moved(counts, work.values, work.anchor, r, slip, work.travel, now[STEP], control.drift)
    now[PAUSE] = now[PAUSE] + now[STEP] if unmoved and now[PAUSE] >= 0.0 else 0.0
    if now[PAUSE] == 0.0:
        start_pause(work.values, work.anchor, work.travel)
    n[SETTLED] = 1 if now[PAUSE] >= control.window else 0
