"""The whole time loop of a run in one compiled call: phases, steps, rest, certificate."""

from typing import NamedTuple

import numpy as np

from engine.friction.arrays import CONVERGED
from engine.kernels.jit import kernel
from engine.kernels.responses import measure
from engine.kernels.step import step

HALVINGS = 4
LOADED = 1e-3  # of the largest impulse: a contact that carries load
OK, NOT_CONVERGED, PENETRATION, DIVERGED, STOPPED = range(5)


class Control(NamedTuple):
    """Settings of a run; lengths and times in the mechanism's units."""

    step: float  # the shortest, and the only one unless longest is larger
    longest: float  # longest step
    travel: float  # the step doubles while no contact point moves farther than this in one
    horizon: float  # longest simulated time
    tolerance: float  # relative residual of every friction problem
    penetration: float  # largest gap violation after a step
    window: float  # nothing measured moves for so long: at rest
    drift: float  # what a length may move meanwhile and count as unmoved
    full_horizon: bool  # go on to the horizon even at rest


class Certificate(NamedTuple):
    """What a run proves of itself; one-element arrays, written by the loop."""

    status: np.ndarray  # (1,) int64, a code above
    steps: np.ndarray  # (1,) int64
    iterations: np.ndarray  # (1,) int64 of the friction solver
    contact: np.ndarray  # (1,) int64 of the largest penetration left
    phase: np.ndarray  # (1,) int64 phase reached
    settled: np.ndarray  # (1,) bool: at rest at the end
    completed: np.ndarray  # (1,) bool: every phase came to its end, those until rest to rest
    time: np.ndarray  # (1,)
    residual: np.ndarray  # (1,) largest
    penetration: np.ndarray  # (1,) largest
    repeated: np.ndarray  # (1,) int64 steps repeated with half their length


def new_certificate() -> Certificate:
    """Return a blank certificate."""
    flags, floats = {"settled", "completed"}, {"time", "residual", "penetration"}
    kinds = [np.bool_ if name in flags else np.float64 if name in floats else np.int64 for name in Certificate._fields]
    return Certificate(*(np.zeros(1, kind) for kind in kinds))


@kernel
def run(model, state, backup, work, problem, control, certificate, stop):
    """Simulate until rest in the last phase, or the horizon, or a failure.

    A step whose friction problem or projection is not solved is repeated with half its length, at most ``HALVINGS``
    times; ``backup`` is a second state, to go back to.

    ``stop``, shape (1,) uint8, is set from another thread to end the run (time limit, cancel).
    """
    h, t = control.step, 0.0
    for phase in range(model.phase_duration.shape[0]):
        certificate.phase[0] = phase
        end = min(t + model.phase_duration[phase], control.horizon)
        until_rest = model.phase_duration[phase] == np.inf
        pause, settled = -1.0, False
        stay = not until_rest or (control.full_horizon and phase == model.phase_duration.shape[0] - 1)
        while t < end - 0.5 * control.step and (stay or not settled):
            before, h = h, min(_next_step(h, state.speed[0], control), end - t)
            _scale_impulses(state.r, h / before)
            copy_state(state, backup)
            whole = h
            status, residual, worst, where = CONVERGED, 0.0, 0.0, -1
            for _ in range(1 + HALVINGS):
                status, residual, worst, where, iterations = step(
                    model, state, work, problem, phase, h, control.tolerance, control.penetration
                )
                certificate.steps[0] += 1
                certificate.iterations[0] += iterations
                if status == CONVERGED and worst <= control.penetration:
                    break
                certificate.repeated[0] += 1
                h *= 0.5
                copy_state(backup, state)
                _scale_impulses(state.r, h / whole)
            t += h
            certificate.time[0] = t
            certificate.residual[0] = max(residual, certificate.residual[0])
            certificate.penetration[0] = max(worst, certificate.penetration[0])
            certificate.status[0] = _verdict(state.v, status, worst, control.penetration, stop[0])
            if certificate.status[0] != OK:
                certificate.contact[0] = where
                return
            measure(model.responses, model.loads, state, work.frame, t, h, work.values, work.a, work.b)
            moved = _moved(model.responses.measures_motion, state, work, h, control.drift)
            pause = 0.0 if moved or pause < 0.0 else pause + h
            if moved or pause == 0.0:
                _drop_anchor(work)
            settled = pause >= control.window
        certificate.settled[0] = settled
        if until_rest and not settled:
            return
    certificate.completed[0] = True


@kernel
def copy_state(source, target):
    """Copy pose, twists and impulses."""
    for body in range(source.x.shape[0]):
        for k in range(3):
            target.x[body, k] = source.x[body, k]
            for j in range(3):
                target.R[body, k, j] = source.R[body, k, j]
        for k in range(4):
            target.p[body, k] = source.p[body, k]
        for k in range(6):
            target.v[body, k] = source.v[body, k]
    for i in range(source.r.shape[0]):
        for k in range(3):
            target.r[i, k] = source.r[i, k]


@kernel
def _next_step(h, speed, control):
    """Return the next step: halved until the fastest contact point moves little enough in it, at most doubled."""
    h = min(2 * h, control.longest)
    while h > control.step and h * speed > control.travel:
        h = max(0.5 * h, control.step)
    return h


@kernel
def _scale_impulses(r, factor):
    """Turn the last step's impulses into a guess for a step of another length."""
    if factor != 1.0:
        for i in range(r.shape[0]):
            for k in range(3):
                r[i, k] *= factor


@kernel
def _verdict(v, status, worst, penetration, stop):
    """Judge the step just made."""
    for body in range(v.shape[0]):
        for k in range(6):
            if not abs(v[body, k]) < np.inf:
                return DIVERGED
    if not worst < np.inf:
        return DIVERGED
    if status != CONVERGED:
        return NOT_CONVERGED
    if worst > penetration:
        return PENETRATION
    return STOPPED if stop != 0 else OK


@kernel
def _drop_anchor(work):
    """Note where everything is now."""
    for i in range(work.values.shape[0]):
        work.anchor[i] = work.values[i]
    for i in range(work.travel.shape[0]):
        work.travel[i] = 0.0


@kernel
def _moved(counts, state, work, h, drift):
    """Say whether anything that matters moved since the anchor: a measured length, a contact that carries load.

    Bodies without load may drift on for ever (a rod that spins slowly between its bearings): they do not count. Contact
    forces do not count either: with everything sticking they may wander inside their indeterminacy.
    """
    moved, load = False, 0.0
    for i in range(work.values.shape[0]):
        if counts[i]:
            moved = moved or not abs(work.values[i] - work.anchor[i]) <= drift
    for i in range(state.slip.shape[0]):
        load = max(load, state.r[i, 0])
    for i in range(state.slip.shape[0]):
        if state.r[i, 0] > LOADED * load:
            work.travel[i] += h * state.slip[i]
            moved = moved or work.travel[i] > drift
    return moved
