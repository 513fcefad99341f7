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
    """The motion of a mechanism after the end of its run."""

    time: Array  # (n,), since the start of the run; the first is the end of the run
    twist: Array  # (n, nb, 6), velocity of the centre of mass, and angular velocity, both in world axes
    own: Array  # (n, nb, 6), the same in body axes
    place: Array  # (n, nb, 7), position of the centre of mass, and quaternion (w, x, y, z)
    impulse: Array  # (n, nc), normal impulses of the contacts
    rested: float | None  # time at which the mechanism came to rest, if it did

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

    The horizon of `control` is not used. With `every_step` few steps are made and each is kept; otherwise twice as many
    as the run made, of which some are kept. None if it was cancelled, took longer than `seconds` of real time, or a
    step failed.
    """
    end, steps = float(course.reals[time_loop.TIME]), int(course.counts[time_loop.ACCEPTED])
    most = FINE if every_step else min(max(2 * steps, FEWEST), MOST)
    length = row_length(len(assembly.model.bodies.mass), len(assembly.contact_names), len(assembly.work.values))
    kept = FINE if every_step else max(min(most, NUMBERS // length), FINE)
    stride = -(-most // kept)
    arrays, course = _copy(assembly.arrays, int(course.counts[time_loop.PHASE])), Course(*map(np.copy, course))
    beyond = end + most * control.longest
    course.reals[time_loop.PHASE_END] = beyond
    # a trial with a shorter step must not begin with the step of the run
    course.reals[time_loop.STEP] = min(course.reals[time_loop.STEP], control.longest)
    course.reals[time_loop.LONGEST] = min(course.reals[time_loop.LONGEST], control.longest)
    course.counts[time_loop.ACCEPTED] = 0
    rows = np.zeros((kept + 2, length))
    with limited(cancel, seconds) as stop:
        run_to_end(arrays, control._replace(horizon=beyond, full_horizon=False), course, rows, stride, stop)
    if course.counts[time_loop.STATUS] not in (time_loop.OK, time_loop.FULL):
        return None
    rows = rows[1 : 1 + int(rows[0, 0])]  # see `kernels.record`
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
