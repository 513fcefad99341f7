"""Continue a run beyond its horizon, step by step, to see what the mechanism does.

Only runs that did not come to rest are continued, on copies of their arrays, by the same time loop.
"""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Array, copied
from engine.assembly import Assembly
from engine.assembly.frames import rotate
from engine.kernels import time_loop
from engine.kernels.context import Control, RunArrays
from engine.kernels.model import Model
from engine.kernels.record import BODY, CONTACT, HEAD, row_length
from engine.kernels.time_loop import Course, run_to_end
from engine.loop import Cancel, limited

FEWEST, MOST = 500, 8000  # steps of a continuation
NUMBERS = 1_000_000  # of a continuation that are kept in memory
FINE = 64  # number of steps that are all kept, to detect trembling


@dataclass(frozen=True)
class Continuation:
    """The motion of a mechanism after the end of its run.

    Attributes
    ----------
    time : (n,) array
        Times since the start of the run; the first is the end of the run.
    twist : (n, nb, 6) array
        Velocity of the centre of mass, and angular velocity, both in world axes.
    own : (n, nb, 6) array
        The same in body axes.
    place : (n, nb, 7) array
        Position of the centre of mass, and quaternion (w, x, y, z).
    impulse : (n, nc) array
        Normal impulses of the contacts.
    rested : float or None
        Time at which the mechanism came to rest, if it did.
    """

    time: Array
    twist: Array
    own: Array
    place: Array
    impulse: Array
    rested: float | None

    def last(self, count: int) -> "Continuation":
        """Return the last ``count`` times of the continuation."""
        kept = {name: x[-count:] for name, x in vars(self).items() if name != "rested"}
        return Continuation(**kept, rested=self.rested)


def go_on(
    assembly: Assembly,
    control: Control,
    course: Course,
    seconds: float,
    cancel: Cancel | None,
    every_step: bool = False,
) -> Continuation | None:
    """Continue the phase in which a run reached its horizon; the run itself is not changed.

    Parameters
    ----------
    assembly : Assembly
        The assembly as the run left it.
    control : Control
        Settings of the continuation; its horizon is not used.
    course : Course
        The course as the run left it.
    seconds : float
        Real time after which the continuation is abandoned [s].
    cancel : Cancel or None
        A flag with which another thread can end it.
    every_step : bool
        Make few steps and keep each one; otherwise make twice as many steps as the run, and keep some of them.

    Returns
    -------
    Continuation or None
        None if it was cancelled, took too long, or a step failed.
    """
    end, steps = float(course.reals[time_loop.TIME]), int(course.counts[time_loop.ACCEPTED])
    most = FINE if every_step else min(max(2 * steps, FEWEST), MOST)
    length = row_length(len(assembly.model.bodies.mass), len(assembly.contact_names), len(assembly.work.values))
    kept = FINE if every_step else max(min(most, NUMBERS // length), FINE)
    stride = -(-most // kept)
    arrays, course = _copy(assembly.arrays, int(course.counts[time_loop.PHASE])), Course(*map(np.copy, course))
    beyond = end + most * control.longest
    course.reals[time_loop.PHASE_END] = beyond
    course.reals[time_loop.STEP] = min(course.reals[time_loop.STEP], control.longest)
    course.reals[time_loop.LONGEST] = min(course.reals[time_loop.LONGEST], control.longest)
    course.counts[time_loop.ACCEPTED] = 0
    rows = np.zeros((kept + 2, length))
    with limited(cancel, seconds) as stop:
        run_to_end(arrays, control._replace(horizon=beyond, full_horizon=False), course, rows, stride, stop)
    if course.counts[time_loop.STATUS] not in (time_loop.OK, time_loop.FULL):
        return None
    rows = rows[1 : 1 + int(rows[0, 0])]
    bodies, contacts = len(arrays.model.bodies.mass), len(assembly.contact_names)
    moving = rows[:, HEAD : HEAD + BODY * bodies].reshape(len(rows), bodies, BODY)
    touching = rows[:, HEAD + BODY * bodies :][:, : CONTACT * contacts].reshape(len(rows), contacts, CONTACT)
    turn, velocity, spin = moving[..., 3:7], moving[..., 7:10], moving[..., 10:13]
    twist = np.concatenate([velocity, rotate(turn, spin)], axis=2)
    own = np.concatenate([rotate(turn * [1, -1, -1, -1], velocity), spin], axis=2)
    rested = float(course.reals[time_loop.TIME]) if course.counts[time_loop.COMPLETED] else None
    return Continuation(rows[:, 0], twist, own, moving[..., :7], touching[..., 1], rested)


def _copy(arrays: RunArrays, phase: int) -> RunArrays:
    """Return copies of all arrays that a run writes; the run ends with the current phase."""
    model, state, work, problem = arrays
    phases = model.phases._replace(**{name: x[: phase + 1] for name, x in model.phases._asdict().items()})
    laws = model.time_laws._replace(begun=model.time_laws.begun.copy())
    rows = model.bilateral._replace(offset=model.bilateral.offset.copy(), acts=model.bilateral.acts.copy())
    model = Model(**{**model._asdict(), "phases": phases, "time_laws": laws, "bilateral": rows})
    return RunArrays(model, copied(state), copied(work), problem)
