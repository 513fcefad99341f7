"""Drive the compiled time loop: settings, time limit, cancellation, and the rows of a trajectory."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from engine.arrays import Array, copied
from engine.assembly import Assembly
from engine.assembly.bilateral import turning_arm
from engine.assembly.table_cache import cached
from engine.jit import Kernel
from engine.kernels import time_loop
from engine.kernels.model import Control, RunArrays
from engine.kernels.record import record, row_length
from engine.kernels.statics import hold_loads, may_hold
from engine.kernels.time_loop import Course, new_course, run_to_end
from engine.mechanism import Mechanism
from engine.platform.clock import set_after

TIMEOUT, CANCELLED = 1, 2  # values of the stop flag
SLOW = 100  # a speed below this multiple of (drift allowed in the window of rest / window) is slow
LOST = 1e6  # a body that moves in a step by more than this multiple of the mechanism's extent is lost
ROOM = 2_000_000  # numbers of a trajectory that are buffered in memory before they are written


class Cancel:
    """A flag that ends a run of `engine.simulate` from another thread, with the status "cancelled"."""

    def __init__(self) -> None:
        self.flag = np.zeros(1, np.uint8)

    def set(self) -> None:
        """End the run at its next time step."""
        self.flag[0] = CANCELLED


def control_of(mechanism: Mechanism, full_horizon: bool) -> Control:
    """Return a mechanism's settings for the time loop."""
    sim = mechanism.simulation
    adaptive, plain = sim.adaptive, sim.scheme == "moreau_jean"
    # the plain scheme projects nothing, so gaps and joints may drift: their errors have no limit
    return Control(
        step=sim.step,
        longest=max(sim.step, adaptive.longest) if adaptive else sim.step,
        travel=adaptive.travel if adaptive else np.inf,
        theta=sim.theta,
        slow=0.0 if plain else SLOW * sim.rest.drift / sim.rest.window,
        plain=plain,
        horizon=sim.horizon,
        tolerance=sim.tolerance,
        penetration=np.inf if plain else sim.penetration,
        violation=np.inf if plain else sim.joint_violation,
        window=sim.rest.window,
        drift=sim.rest.drift,
        full_horizon=full_horizon,
        pauses=False,
        lost=LOST * _extent(mechanism),
    )


@cached
def _extent(mechanism: Mechanism) -> float:
    """Return the largest distance of a body from the world's origin at the start, or its own size if that is larger."""
    far = [float(np.linalg.norm(body.origin)) for body in mechanism.bodies.values()]
    return max([*far, *(turning_arm(mechanism, [name]) for name, body in mechanism.bodies.items() if not body.fixed)])


def prepare(assembly: Assembly, control: Control) -> None:
    """Compile the time loop and the balance at rest, or load them from the cache, by calls that change nothing."""
    variant = assembly.model.contacts.hulls is None  # without meshes, kernels are compiled without what only these need
    nowhere = control._replace(horizon=0.0)

    def untouched() -> RunArrays:
        """Return the arrays with copies of what a run writes."""
        return assembly.arrays._replace(state=copied(assembly.state), work=copied(assembly.work))

    if isinstance(run_to_end, Kernel):
        run_to_end.prepare(
            variant,
            lambda: (assembly.arrays, nowhere, new_course(nowhere), np.zeros((1, 1)), 0, np.zeros(1, np.uint8)),
        )
    if isinstance(hold_loads, Kernel):  # the contacts' places were found at the start; without any of them near
        hold_loads.prepare(variant, lambda: (untouched(), 0, 0.0, control.step, -np.inf))
    if isinstance(may_hold, Kernel) and len(assembly.model.phases.duration) > 1:
        may_hold.prepare(variant, lambda: (untouched(), 0, 0.0, control.step))


def drive(
    assembly: Assembly,
    control: Control,
    wall_limit: float,
    cancel: Cancel | None = None,
    sink: Callable[[Array], None] | None = None,
    every: int = 1,
    moves: Callable[[Course], bool] | None = None,
    released: Callable[[Course], None] | None = None,
) -> Course:
    """Run the time loop to its end, or until some real time [s] has passed or another thread cancels it.

    In a pose at rest that nothing holds, bodies may have started to move so slowly that it cannot be seen yet. The run
    then continues until nothing has moved for twice the window of rest and something holds the pose; if nothing does,
    for four times the window, and so on up to the horizon. ``moves`` tells whether bodies start to move in the pose at
    rest. It is asked at the end of the last phase, and of every phase at rest in which forces are read, where it may
    write the forces that balance the loads; it does not change the motion. ``released`` is called where a later phase
    begins at rest, and may change the impulses with which its first step begins.

    The sink gets blocks of rows of the trajectory, see `kernels.record`: every ``every``-th step and the last one.
    """
    model, state, work = assembly.model, assembly.state, assembly.work
    prepare(assembly, control)
    course = new_course(control)
    length = row_length(len(model.bodies.mass), len(assembly.contact_names), len(work.values))
    # the first row counts the others, see `kernels.record`
    rows = np.zeros((1 + (max(ROOM // length, 16) if sink else 0), length))
    stride = every if sink else 0
    try:
        with limited(cancel, wall_limit) as stop:
            window = control.window
            while True:
                settings = control._replace(window=window, pauses=moves is not None)
                run_to_end(assembly.arrays, settings, course, rows, stride, stop)
                if course.counts[time_loop.STATUS] == time_loop.FULL and sink:
                    _flush(rows, sink)
                elif course.counts[time_loop.STATUS] == time_loop.RELEASED:
                    if released:
                        released(course)
                elif moves and course.counts[time_loop.STATUS] == time_loop.PHASE_OVER:
                    if moves(course) and _ends_at_rest(assembly, course):
                        window *= 2
                        course.counts[time_loop.SETTLED] = 0
                    else:
                        window = control.window
                        course.counts[time_loop.BALANCED] = course.counts[time_loop.PHASE]
                elif moves and _rests_early(assembly, control, course) and moves(course):
                    window *= 2
                    course.counts[[time_loop.SETTLED, time_loop.COMPLETED]] = 0
                else:
                    break
            if _rests(assembly, control, course):
                # the horizon leaves no time for a longer window
                course.counts[[time_loop.SETTLED, time_loop.COMPLETED]] = 1
    finally:
        if sink:  # the loop records the start of a step, so the end of the last one is missing, whatever ended the run
            if record(model, state, work, course.reals[time_loop.TIME], course.reals[time_loop.STEP], rows):
                _flush(rows, sink)
                record(model, state, work, course.reals[time_loop.TIME], course.reals[time_loop.STEP], rows)
            _flush(rows, sink)
    return course


def _rests(assembly: Assembly, control: Control, course: Course) -> bool:
    """Return whether a run is in a last phase that ends at rest, and nothing has moved for the window of rest."""
    last = course.counts[time_loop.PHASE] == len(assembly.model.phases.duration) - 1
    ended = last and _ends_at_rest(assembly, course) and course.counts[time_loop.STATUS] == time_loop.OK
    return bool(ended and course.reals[time_loop.PAUSE] >= control.window)


def _ends_at_rest(assembly: Assembly, course: Course) -> bool:
    """Return whether the current phase has neither a duration nor an event that ends it."""
    phases, phase = assembly.model.phases, course.counts[time_loop.PHASE]
    return bool(phases.duration[phase] == np.inf and phases.trigger[phase] < 0)


def _rests_early(assembly: Assembly, control: Control, course: Course) -> bool:
    """Return whether a run is at rest before its horizon."""
    early = course.reals[time_loop.TIME] < course.reals[time_loop.PHASE_END] - 0.5 * control.step
    return bool(early and _rests(assembly, control, course))


@contextmanager
def limited(cancel: Cancel | None, seconds: float) -> Iterator[Any]:
    """Yield the flag that ends the time loop, set by another thread or, after some real time [s], by the clock."""
    stop = (cancel or Cancel()).flag
    try:
        with set_after(seconds, stop, TIMEOUT):
            yield stop
    finally:
        if stop[0] == TIMEOUT:
            stop[0] = 0  # the limit belonged to this run; the caller may reuse the flag for the next one


def _flush(rows: Array, sink: Callable[[Array], None]) -> None:
    """Pass the rows written so far to the sink, and clear the buffer."""
    sink(rows[1 : 1 + int(rows[0, 0])])
    rows[0, 0] = 0
