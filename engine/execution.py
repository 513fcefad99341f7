"""Execute one run of an assembled mechanism: the time loop, the forces at rest, derived responses, the verdict."""

import math
import time
from collections.abc import Callable, Mapping
from functools import lru_cache

from engine.arrays import Array
from engine.assembly import Assembly
from engine.equilibrium import PoseAtRest
from engine.kernels import time_loop
from engine.kernels.time_loop import Course
from engine.loop import Cancel, control_of, drive, prepare
from engine.mechanism import Mechanism
from engine.mechanism.responses import ConditionMet, ContactForce, ResponseDifference
from engine.not_at_rest import describe_motion, flight, in_flight, unheld
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
    """Run the time loop from an assembly at its start, and judge its outcome.

    With ``full_horizon`` it does not stop at rest in the last phase; with ``indeterminacy`` the ranges of the contact
    forces at rest are computed, too. For ``sink`` and ``every`` see `engine.loop.drive`.
    """
    control = control_of(mechanism, full_horizon)
    unmoved = control.drift / control.window  # speed below which a body counts as unmoved
    prepare(assembly, control)  # before the clock starts: the time it takes to compile is not that of the run

    @lru_cache(maxsize=1)  # the last pose examined is the final one if the run comes to rest
    def pose_at(phase: int, t: float) -> PoseAtRest:
        return PoseAtRest(mechanism, assembly, phase, t)

    def moves(course: Course) -> bool:
        pose = pose_at(int(course.counts[time_loop.PHASE]), float(course.reals[time_loop.TIME]))
        return pose.moves or bool(in_flight(assembly, pose.assembly, unmoved).any())

    start = time.perf_counter()
    course = drive(assembly, control, mechanism.simulation.wall_limit, cancel, sink, every, moves)
    counts, reals = course.counts, course.reals
    certificate = Certificate(
        steps=int(counts[time_loop.STEPS]),
        time=float(reals[time_loop.TIME]),
        wall_s=time.perf_counter() - start,
        max_residual=float(reals[time_loop.MAX_RESIDUAL]),
        max_penetration=float(reals[time_loop.MAX_PENETRATION]),
        max_violation=float(reals[time_loop.MAX_VIOLATION]),
        max_created_energy=float(reals[time_loop.MOST_CREATED]),
        created_energy=float(reals[time_loop.ALL_CREATED]),
        settled=bool(counts[time_loop.SETTLED]),
        iterations=int(counts[time_loop.ITERATIONS]),
        repeated=int(counts[time_loop.REPEATED]),
    )
    ranges: dict[str, tuple[float, float]] = {}  # by contact
    last = mechanism.phases[-1]
    until_rest = last.duration is None and last.until is None and not full_horizon
    drift, reported, read_at_end = "", assembly.work.reported, read_contacts(mechanism)
    if counts[time_loop.STATUS] == time_loop.OK and certificate.settled:
        pose = pose_at(int(counts[time_loop.PHASE]), certificate.time)
        contacts = [*bounded_contacts(mechanism), *(read_at_end.values() if indeterminacy else ())]
        if pose.moves:
            drift = unheld(mechanism, pose.assembly, control)
        elif until_rest:  # in a phase with a duration a part may fly off
            drift = flight(mechanism, pose.assembly, control, in_flight(assembly, pose.assembly, unmoved))
        ranges, reported = pose.ranges(list(dict.fromkeys(contacts))), pose.reported
    measured = dict(zip(mechanism.responses, map(float, reported), strict=True))
    measured = with_derived(mechanism, measured, ranges)
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
    open_ranges = {name: ranges[contact] for name, contact in read_at_end.items() if contact in ranges}
    return Run(status, message, responses, mechanism.response_units(), certificate, measured, open_ranges)


def bounded_contacts(mechanism: Mechanism) -> list[str]:
    """Return the contacts whose force range at rest is used by a response."""
    responses = mechanism.responses.values()
    return list(dict.fromkeys(r.contact for r in responses if isinstance(r, ContactForce) and r.bound))


def read_contacts(mechanism: Mechanism) -> dict[str, str]:
    """Return a mapping response -> contact for all normal forces that are read at the end of the run."""
    return {
        name: r.contact
        for name, r in mechanism.responses.items()
        if isinstance(r, ContactForce) and r.component == "normal" and r.at == "end" and r.bound is None
    }


def with_derived(mechanism: Mechanism, measured: Mapping[str, float], ranges: Mapping[str, Range]) -> dict[str, float]:
    """Return the measured responses together with those derived from them; NaN: no value.

    ``ranges`` gives the smallest and largest normal force at rest by contact; contacts that were not at rest are
    missing.
    """
    responses = dict(measured)
    for name, response in mechanism.responses.items():
        if isinstance(response, ResponseDifference):
            responses[name] = measured[response.of[0]] - measured[response.of[1]]
        elif isinstance(response, ConditionMet):
            defined = not math.isnan(measured[response.condition.response])
            responses[name] = float(response.condition.holds(measured)) if defined else math.nan
        elif isinstance(response, ContactForce) and response.bound:
            least, largest = ranges.get(response.contact, (math.nan, math.nan))
            responses[name] = least if response.bound == "least" else largest
    return responses
