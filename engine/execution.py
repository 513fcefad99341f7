"""Execute one run of an assembled mechanism: the time loop, the forces at rest, derived responses, the verdict."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from engine.arrays import Array, copied
from engine.assembly import Assembly
from engine.assembly.table_cache import cached
from engine.equilibrium import (
    SHORT,
    PoseAtRest,
    balancing_forces,
    find_contacts_at_pose,
    forces_at_rest,
    touching_gap,
)
from engine.kernels import time_loop
from engine.kernels.model import Control, Scratch
from engine.kernels.statics import MOVING, may_hold
from engine.kernels.time_loop import Course, run_to_end
from engine.loop import Cancel, control_of, drive, prepare
from engine.mechanism import Mechanism
from engine.mechanism.expression import ExpressionFault, evaluate, parse
from engine.mechanism.responses import (
    ConditionMet,
    ContactForce,
    Derived,
    Formula,
    Response,
    ResponseDifference,
    in_formulas,
    order_of_derived,
)
from engine.not_at_rest import describe_motion, flight, in_flight, unheld
from engine.not_at_rest.continuation import copy_of
from engine.run import Certificate, Run
from engine.verdict import failure, judge, unfinished

Range = tuple[float, float]


def execute(
    mechanism: Mechanism,
    assembly: Assembly,
    full_horizon: bool,
    cancel: Cancel | None,
    indeterminacy: bool = False,
    sink: Callable[[Array], None] | None = None,
    every: int = 1,
) -> Run:
    """Run the time loop from an assembly at its start, and judge it; for ``sink`` and ``every`` see `drive`."""
    control = control_of(mechanism, full_horizon)
    prepare(assembly, control)  # before the clock starts: the time it takes to compile is not that of the run
    rest = _Rest(mechanism, assembly, control, indeterminacy)
    start = time.perf_counter()
    course = drive(assembly, control, mechanism.simulation.wall_limit, cancel, sink, every, rest.moves, rest.released)
    certificate = _certificate(course, time.perf_counter() - start, assembly.travel)
    counts, last = course.counts, mechanism.phases[-1]
    until_rest = last.duration is None and last.until is None and not full_horizon
    drift, work = "", assembly.work
    if counts[time_loop.STATUS] == time_loop.OK and certificate.settled:
        drift, work = rest.examine_end(course, until_rest)
    measured = dict(zip(mechanism.responses, map(float, work.reported), strict=True))
    measured = with_derived(mechanism, measured, rest.ranges)
    if counts[time_loop.STATUS] == time_loop.OK:
        if counts[time_loop.COMPLETED] or full_horizon:
            status, message = judge(mechanism, measured, certificate.settled, drift, until_rest)
        else:
            left = mechanism.simulation.wall_limit - certificate.wall_s
            motion = "" if certificate.settled else describe_motion(mechanism, assembly, control, course, left, cancel)
            status, message = unfinished(mechanism, int(counts[time_loop.PHASE]), certificate.settled, motion)
    else:
        status, message = failure(mechanism, assembly, course)
    responses = measured if status == "ok" else {}
    open_ranges = {n: ends for n, ends in rest.ranges.items() if getattr(mechanism.responses[n], "bound", None) is None}
    struck = [name for name, at_impact in zip(mechanism.responses, work.at_impact, strict=True) if at_impact]
    return Run(
        status,
        message,
        responses,
        mechanism.response_units(),
        certificate,
        measured,
        open_ranges,
        at_impact=_with_what_follows(mechanism, struck),
        ambiguous=any(rest.choices),
    )


def _certificate(course: Course, wall_s: float, travel: float) -> Certificate:
    """Return what the time loop counted and found."""
    counts, reals = course.counts, course.reals
    return Certificate(
        steps=int(counts[time_loop.STEPS]),
        time=float(reals[time_loop.TIME]),
        wall_s=wall_s,
        max_residual=float(reals[time_loop.MAX_RESIDUAL]),
        max_penetration=float(reals[time_loop.MAX_PENETRATION]),
        max_violation=float(reals[time_loop.MAX_VIOLATION]),
        max_created_energy=float(reals[time_loop.MOST_CREATED]),
        created_energy=float(reals[time_loop.ALL_CREATED]),
        max_lost_energy=float(reals[time_loop.MOST_LOST]),
        lost_energy=float(reals[time_loop.ALL_LOST]),
        max_kinetic_energy=float(reals[time_loop.PEAK_KINETIC]),
        max_turn=float(reals[time_loop.MOST_TURN]),
        settled=bool(counts[time_loop.SETTLED]),
        iterations=int(counts[time_loop.ITERATIONS]),
        repeated=int(counts[time_loop.REPEATED]),
        start_travel=travel,
    )


class _Rest:
    """What is found where a run comes to rest, at the end of each of its phases."""

    def __init__(self, mechanism: Mechanism, assembly: Assembly, control: Control, indeterminacy: bool) -> None:
        self.mechanism, self.assembly, self.control = mechanism, assembly, control
        self.indeterminacy = indeterminacy  # whether all normal forces have ranges, not only those asked for
        self.ranges: dict[str, Range] = {}  # of forces read at rest, by response
        self.choices: list[bool] = []  # whether rest was one of two solutions, where that was asked
        # the last pose examined is the final one if the run comes to rest
        self._at: tuple[int, float, float] | None = None
        self._pose: PoseAtRest | None = None
        self._flying: Array | None = None

    def moves(self, course: Course) -> bool:
        """Return whether bodies move that the time loop counts as resting; if they do not, let the next phase begin."""
        pose, phase = self._pose_of(course), int(course.counts[time_loop.PHASE])
        if phase == len(self.mechanism.phases) - 1:
            return pose.moves or bool(self._in_flight(pose).any())
        if not pose.moves:
            pose.hand_over(self.assembly)
            self._add_ranges(pose, phase)
            self.choices.append(pose.ambiguous)
        return pose.moves

    def released(self, course: Course) -> None:
        """Let a phase that begins at rest stay so if its contacts can hold the new loads."""
        self.choices.append(stay_at_rest(self.assembly, self.control, course, touching_gap(self.mechanism)))

    def examine_end(self, course: Course, until_rest: bool) -> tuple[str, Scratch]:
        """Return why a run that settled is not at rest, else "", and the arrays that its responses are read from."""
        pose, drift = self._pose_of(course), ""
        self.choices.append(pose.ambiguous)
        if pose.moves:
            drift = unheld(self.mechanism, pose.assembly, self.control)
        elif until_rest:  # in a phase with a duration a part may fly off
            drift = flight(self.mechanism, pose.assembly, self.control, self._in_flight(pose))
        self._add_ranges(pose, len(self.mechanism.phases) - 1)
        return drift, pose.assembly.work

    def _pose_of(self, course: Course) -> PoseAtRest:
        t, h = map(float, course.reals[[time_loop.TIME, time_loop.STEP]])
        at = (int(course.counts[time_loop.PHASE]), t, h)
        if self._pose is None or at != self._at:
            self._at, self._flying = at, None
            self._pose = PoseAtRest(self.mechanism, self.assembly, *at)
        return self._pose

    def _in_flight(self, pose: PoseAtRest) -> Array:
        if self._flying is None:
            unmoved = self.control.drift / self.control.window  # speed below which a body counts as unmoved
            self._flying = in_flight(self.assembly, pose.assembly, unmoved)
        return self._flying

    def _add_ranges(self, pose: PoseAtRest, phase: int) -> None:
        contacts = contacts_with_ranges(self.mechanism, phase, forces=self.indeterminacy)
        found = pose.ranges(list(dict.fromkeys(contacts.values())))
        self.ranges.update({name: found[contact] for name, contact in contacts.items() if contact in found})


def _with_what_follows(mechanism: Mechanism, names: list[str]) -> tuple[str, ...]:
    """Return responses and those derived from them, in the order of the mechanism."""
    if not names:
        return ()
    known, concerned = in_formulas(mechanism.responses), set(names)
    for name in _derived_in_order(mechanism):
        response = mechanism.responses[name]
        if isinstance(response, Derived) and any(known.get(part) in concerned for part in response.sources):
            concerned.add(name)
    return tuple(name for name in mechanism.responses if name in concerned)


def contacts_with_ranges(mechanism: Mechanism, phase: int, *, forces: bool = False) -> dict[str, str]:
    """Return response -> contact for the bounds read at the end of a phase, and with ``forces`` for normal forces."""
    names = [each.name for each in mechanism.phases]
    return {
        name: r.contact
        for name, r in mechanism.responses.items()
        if isinstance(r, ContactForce) and r.component == "normal" and r.at == "end"
        if (forces or r.bound) and (r.to_phase or names[-1]) == names[phase]
    }


def with_derived(mechanism: Mechanism, measured: Mapping[str, float], ranges: Mapping[str, Range]) -> dict[str, float]:
    """Return the responses measured, bounds from ``ranges`` at rest, and those derived from them; NaN: no value."""
    responses = dict(measured)
    for name, response in mechanism.responses.items():
        if isinstance(response, ContactForce) and response.bound:
            least, largest = ranges.get(name, (math.nan, math.nan))
            responses[name] = least if response.bound == "least" else largest
    for name in _derived_in_order(mechanism):
        responses[name] = _derived(mechanism, mechanism.responses[name], responses)
    return responses


@cached
def _derived_in_order(mechanism: Mechanism) -> list[str]:
    """Return the responses that follow from others, each after those."""
    return order_of_derived(mechanism.responses)


def _derived(mechanism: Mechanism, response: Response, responses: Mapping[str, float]) -> float:
    """Return the value of a response from those it follows from; NaN if one has none, or its formula has none."""
    if isinstance(response, ResponseDifference):
        return responses[response.of[0]] - responses[response.of[1]]
    if isinstance(response, ConditionMet):
        defined = not math.isnan(responses[response.condition.response])
        return float(response.condition.holds(responses)) if defined else math.nan
    assert isinstance(response, Formula)
    known = in_formulas(mechanism.responses)
    names = {part: responses[known[part]] for part in response.sources if part in known}
    if any(map(math.isnan, names.values())):
        return math.nan
    try:
        return evaluate(parse(response.formula), {**mechanism.parameters, **names})
    except ExpressionFault:
        return math.nan


# Where a phase begins at rest, both rest and motion may solve its equations: then rest goes on.
#
# A bracket on a post locks itself: friction holds it while its rings press on the post, and they press while friction
# holds it. To fall freely is a solution as well, and which one a step finds is an accident of its solver. Real contacts
# are not quite rigid and hold as they held before. So the run stays at rest if any forces of the contacts that carried
# load hold the new loads, and it says that this was a choice.


def stay_at_rest(assembly: Assembly, control: Control, course: Course, touching: float) -> bool:
    """Let a phase that begins at rest stay so, if need be with other impulses; return whether there was a choice."""
    h, t = map(float, course.reals[[time_loop.STEP, time_loop.TIME]])
    phase = int(course.counts[time_loop.PHASE])
    last = assembly.state.r / h
    if not last.any():
        return False
    find_contacts_at_pose(assembly)
    if not may_hold(assembly.arrays, phase, t, SHORT * control.step):
        return False
    falls = _moves(assembly, control, course, assembly.state.r)
    if falls is None or not (falls or _moves(assembly, control, course, np.zeros_like(last))):
        return False
    pose = replace(assembly, state=copied(assembly.state), work=copied(assembly.work))
    forces_at_rest(pose, phase, control.step, touching, t)  # for the loads, and the rows of the contacts
    held = balancing_forces(pose, last, control.step, only_loaded=True)
    if held is None:
        return False
    if falls:
        if _moves(assembly, control, course, h * held) is not False:
            return False
        assembly.state.r[:] = h * held
    return True


def _moves(assembly: Assembly, control: Control, course: Course, impulses: Array) -> bool | None:
    """Return whether bodies move in the next step if its solution begins with these; None if driven, or if it fails."""
    arrays, trial = copy_of(assembly.arrays, int(course.counts[time_loop.PHASE])), Course(*map(np.copy, course))
    arrays.state.r[:] = impulses
    only_one_step = np.ones(1, np.uint8)
    run_to_end(arrays, control._replace(pauses=False), trial, np.zeros((1, 1)), 0, only_one_step)
    target = arrays.work.bilateral.target
    if trial.counts[time_loop.STATUS] != time_loop.STOPPED or (target[0] != target[1]).any() or target[2].any():
        return None
    bodies, wrench, twist = arrays.model.bodies, arrays.work.wrench[:-1], arrays.state.v[:-1]
    moment = np.einsum("bji,bj->bi", arrays.state.R[:-1], wrench[:, 3:])
    spin = np.einsum("bij,bj->bi", bodies.inverse_root, moment)
    h = float(trial.reals[time_loop.STEP])
    free = h**2 * float((wrench[:, :3] ** 2 / bodies.mass[:, None]).sum() + (spin**2).sum())
    spins = np.einsum("bi,bij,bj->", twist[:, 3:], bodies.inertia, twist[:, 3:])
    return float(bodies.mass @ (twist[:, :3] ** 2).sum(axis=1) + spins) > MOVING * free
