"""Describe the motion of a mechanism that did not come to rest, and what would bring it to rest."""

import math
from collections.abc import Iterator

import numpy as np

from engine.arrays import Array
from engine.assembly import Assembly
from engine.assembly.frames import order_bodies
from engine.kernels import time_loop
from engine.kernels.context import Control
from engine.kernels.loads import apply_loads
from engine.kernels.time_loop import Course
from engine.loop import Cancel
from engine.mechanism import Mechanism
from engine.unrest.continuation import FINE, Continuation, go_on
from engine.unrest.course_of_speed import SpeedCourse, course_of, turns_of
from engine.unrest.direction_words import HINGED, direction_words, joint_lines
from engine.unrest.mover import Mover, find_mover
from engine.unrest.two_places import held_in_turn

TREMBLES = FINE // 8  # smallest number of reversals in that many steps
GETS_NOWHERE = 0.1  # share of the distance that a body would cover at its speed
TRIALS = (0.5, 0.25, 0.125)  # shares of the step that are tried if something trembles
PURE = 0.05  # share of a motion's square above which it is more than a displacement, or more than a turn
NO_LOAD = 1e-6  # share of the largest load below which none acts along a motion
BEYOND = 1.2  # a sufficient horizon, as a multiple of the time of rest


def unrest(
    mechanism: Mechanism, assembly: Assembly, control: Control, course: Course, seconds: float, cancel: Cancel | None
) -> str:
    """Describe which body moves most at the end of a run, where to, how fast, and what would bring it to rest.

    `assembly` and `course` are as the run left them; the arrays of loads are overwritten. `seconds` is the real time
    available to see how the mechanism continues. Returns part of a sentence, empty if nothing could be seen.
    """
    fine = go_on(assembly, control, course, seconds, cancel, every_step=True)
    if fine is None or len(fine.time) < 3:
        return ""
    trial = (assembly, control, course, seconds, cancel)
    if trembling := _trembling(mechanism, fine, *trial):
        return trembling
    mover = find_mover(assembly, control, fine.twist, fine.own)
    onward = go_on(*trial)
    if onward is None or len(onward.time) < 3:
        return _motion(mechanism, assembly, mover, "goes on")
    if trembling := _trembling(mechanism, onward.last(FINE), *trial):
        return trembling
    mover = find_mover(assembly, control, onward.twist, onward.own)
    if onward.rested is not None:
        return f"{_motion(mechanism, assembly, mover, 'still moves')}; " + _longer(mechanism, onward.rested, "comes")
    speeds = course_of(onward.time, mover.speed, control.window, control.drift)
    loaded = _is_loaded(assembly, mover, course)
    return "; ".join([_motion(mechanism, assembly, mover, speeds.kind, loaded), *_advice(mechanism, speeds, loaded)])


def unheld(mechanism: Mechanism, pose: Assembly, control: Control) -> str:
    """Describe which body starts to move at a pose that no contact forces hold; empty if that is not known.

    `pose` is as `engine.equilibrium.forces_at_rest` left it.
    """
    motion = _begun(mechanism, pose, control, pose.state.v, "begins")
    return f"no contact forces hold the pose: {motion}" if motion else ""


def flight(mechanism: Mechanism, pose: Assembly, control: Control, twist: Array) -> str:
    """Describe which body is in flight while everything measured is at rest; empty if none is.

    `pose` is that at the end of the run, `twist`, shape (nb + 1, 6), is from `engine.unrest.in_flight`.
    """
    motion = _begun(mechanism, pose, control, twist, "flies")
    return f"{motion}, and no contact, joint or spring holds it" if motion else ""


def _begun(mechanism: Mechanism, pose: Assembly, control: Control, twist: Array, kind: str) -> str:
    """Describe the motion of the body that moves most with these twists, shape (nb + 1, 6)."""
    spin = np.einsum("bij,bj->bi", pose.state.R[:-1], twist[:-1, 3:])
    motion = np.concatenate([twist[:-1, :3], spin], axis=1)[None]
    if not motion.any():
        return ""
    return _motion(mechanism, pose, find_mover(pose, control, motion, motion), kind)


def _motion(mechanism: Mechanism, assembly: Assembly, mover: Mover, kind: str, loaded: bool = True) -> str:
    """Describe the body, direction and speed of a motion; without the speed if ``kind`` is "begins"."""
    body, length, time = order_bodies(mechanism)[mover.body], mechanism.unit("length"), mechanism.unit("time")
    R, moves, turns = assembly.state.R[mover.body], mover.along @ mover.along, mover.about @ mover.about
    to_and_fro = kind in ("swings", "trembles")
    speed = float(np.abs(mover.speed).max() if to_and_fro else abs(mover.speed[0]))
    before = " at up to " if to_and_fro else " at "
    slides = "" if kind == "begins" else f"{before}{speed * math.sqrt(moves):.3g} {length}/{time}"
    spins = "" if kind == "begins" else f"{before}{speed * math.sqrt(turns) / mover.arm:.3g} rad/{time}"
    if not turns > PURE:
        along = direction_words(mechanism, body, R, mover.along, signed=not to_and_fro)
        verb = kind if to_and_fro or kind == "flies" else "slides" if loaded else "floats"
        return f"{body} {verb} along {along}{slides}"
    verb, about = kind if to_and_fro else "turns", direction_words(mechanism, body, R, mover.about, signed=False)
    if not moves > PURE or _is_hinged(mechanism, assembly, mover):
        return f"{body} {verb} about {about}{spins}"
    along = direction_words(mechanism, body, R, mover.along, signed=not to_and_fro)
    return f"{body} moves along {along}{slides} and {verb} about {about}{spins}"


def _is_hinged(mechanism: Mechanism, assembly: Assembly, mover: Mover) -> bool:
    """Return whether a joint of the body lies on the axis of its motion."""
    body, spin = order_bodies(mechanism)[mover.body], mover.about / mover.arm
    for _, point, _ in joint_lines(mechanism, body, assembly.state.R[mover.body]):
        there = mover.along + np.cross(spin, point)
        if np.linalg.norm(there) < HINGED * np.linalg.norm(mover.along):
            return True
    return False


def _is_loaded(assembly: Assembly, mover: Mover, course: Course) -> bool:
    """Return whether a load acts on the body along its motion."""
    model, state, work, body = assembly.model, assembly.state, assembly.work, mover.body
    phase, t = int(course.counts[time_loop.PHASE]), float(course.reals[time_loop.TIME])
    apply_loads(model.bodies, model.loads, model.time_laws, state, phase, t, work.wrench, work.vectors)
    forces, torques = work.wrench[:-1, :3], work.wrench[:-1, 3:] / mover.arm
    size = np.sqrt((forces**2).sum(axis=1) + (torques**2).sum(axis=1)).max()
    along = forces[body] @ mover.along + torques[body] @ mover.about
    return bool(abs(along) > NO_LOAD * size)


def _advice(mechanism: Mechanism, speeds: SpeedCourse, loaded: bool) -> Iterator[str]:
    """Yield how the motion continues, and what would end it."""
    time, result = mechanism.unit("time"), "if this motion is the result, give the phase a duration"
    if speeds.kind == "swings":
        period = f"its period is {speeds.period:.3g} {time}"
        lost = "" if speeds.loss is None else f"it loses {100 * speeds.loss:.2g} % of its amplitude in each"
        yield " and ".join(filter(None, (period, lost)))
        if speeds.rest is not None:
            yield _longer(mechanism, speeds.rest, "would come")
        elif speeds.loss is not None:
            yield "next to nothing damps it: add a damper, friction or a damping of the phase"
        else:
            yield "raise simulation.horizon"
        yield result
    elif speeds.kind == "turns back":
        yield "it turns back later"
        yield f"raise simulation.horizon; {result}"
    elif speeds.kind == "slows":
        yield "it slows down"
        yield "raise simulation.horizon" if speeds.rest is None else _longer(mechanism, speeds.rest, "would come")
    elif not loaded:
        yield "no load acts on it in this direction and nothing stops it"
        yield "load it there with a spring, a force or gravity, stop it with a contact, or do not measure it at the end"
        yield result
    elif speeds.kind == "steady":
        yield "its speed does not change"
        yield f"raise simulation.horizon if a stop is to end this motion; {result}"
    else:
        yield "it gets faster and faster, and nothing holds it"
        yield f"hold it with a stop, friction or a spring; {result}"


def _longer(mechanism: Mechanism, rest: float, comes: str) -> str:
    """Return how long the mechanism takes to come to rest, and a sufficient horizon."""
    unit, wanted = mechanism.unit("time"), BEYOND * rest
    digit = 10.0 ** (math.floor(math.log10(wanted)) - 1)
    horizon = math.ceil(wanted / digit) * digit
    return f"it {comes} to rest at about {rest:.3g} {unit}: raise simulation.horizon to {horizon:.3g}"


def _trembling(
    mechanism: Mechanism,
    onward: Continuation,
    assembly: Assembly,
    control: Control,
    course: Course,
    seconds: float,
    cancel: Cancel | None,
) -> str:
    """Describe what trembles from step to step over a short time, and what would end it; empty if nothing does."""
    mover = find_mover(assembly, control, onward.twist, onward.own)
    span = float(onward.time[-1] - onward.time[0])
    if onward.rested is not None or span > 2 * FINE * control.longest:  # a slow motion to and fro, not trembling
        return ""
    if len(turns_of(mover.speed)) < TREMBLES and not (_stays(onward, mover, span) and held_in_turn(assembly, onward)):
        return ""
    advice = _shorter_step(mechanism, assembly, control, course, seconds, cancel) or _places(assembly, onward)
    return f"{_motion(mechanism, assembly, mover, 'trembles')}; {advice}"


def _stays(onward: Continuation, mover: Mover, span: float) -> bool:
    """Return whether the body gets nowhere at its speed, because the projection undoes the motion of each step."""
    moved = onward.place[-1, mover.body, :3] - onward.place[0, mover.body, :3]
    went = float(np.abs(mover.speed).mean()) * math.hypot(*mover.along) * span
    return math.hypot(*moved) < GETS_NOWHERE * went  # hypot avoids squares, which may overflow for a runaway body


def _shorter_step(
    mechanism: Mechanism, assembly: Assembly, control: Control, course: Course, seconds: float, cancel: Cancel | None
) -> str:
    """Return which shorter step brings to rest what trembles from step to step; empty if none does."""
    unit = mechanism.unit("time")
    for share in TRIALS:
        step = share * control.step
        shorter = control._replace(step=step, longest=step)
        onward = go_on(assembly, shorter, course, seconds, cancel)
        if onward is not None and onward.rested is not None:
            return f"the step of {control.step:g} {unit} is too long: with {step:g} {unit} it comes to rest"
    return ""


def _places(assembly: Assembly, onward: Continuation) -> str:
    """Return what may help if no shorter step does: a separate contact for each of two places that one has to hold."""
    if names := held_in_turn(assembly, onward):
        which, needs = ("contact", "it needs") if len(names) == 1 else ("contacts", "they need")
        return (
            f"{which} {', '.join(names)} would have to hold at two places at once, and a contact acts at one point: "
            f"{needs} a contact for each, such as two planes in place of a groove"
        )
    return "it changes its direction within a few steps: a shorter simulation.step may help"
