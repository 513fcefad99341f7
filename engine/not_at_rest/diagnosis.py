"""Describe the motion of a mechanism that did not come to rest, and what would bring it to rest.

Bodies in flight, which fall or continue at a constant speed, move although everything measured is at rest.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array
from engine.assembly import Assembly
from engine.assembly.frames import order_bodies
from engine.kernels import time_loop
from engine.kernels.links import link_bodies
from engine.kernels.loads import apply_loads
from engine.kernels.model import SLIDE, Control
from engine.kernels.time_loop import Course
from engine.loop import Cancel
from engine.mechanism import Mechanism
from engine.not_at_rest.continuation import (
    FINE,
    Continuation,
    DominantMotion,
    SpeedTrend,
    alternating_contacts,
    dominant_motion,
    go_on,
    speed_trend,
    turns_of,
)

Chosen = NDArray[np.bool_]

HELD = 1e-9  # share of a group's speed at which a joint or a gap may still change
LOADED = 1e-6  # share of the largest load below which a load counts as zero

TREMBLES = FINE // 8  # smallest number of reversals in that many steps
GETS_NOWHERE = 0.1  # share of the distance that a body would cover at its speed
TRIALS = (0.5, 0.25, 0.125)  # shares of the step that are tried if something trembles
PURE = 0.05  # share of a motion's square above which it is more than a displacement, or more than a turn
NO_LOAD = 1e-6  # share of the largest load below which none acts along a motion
BEYOND = 1.2  # a sufficient horizon, as a multiple of the time of rest

HINGED = 0.3  # share of a body's motion that a joint with play allows at its axis
PARALLEL = 0.99  # cosine of 8 degrees, because a body in a joint with play tilts


def describe_motion(
    mechanism: Mechanism, assembly: Assembly, control: Control, course: Course, seconds: float, cancel: Cancel | None
) -> str:
    """Describe which body moves most at the end of a run, where to, how fast, and what would bring it to rest.

    `assembly` and `course` are as the run left them; the arrays of loads are overwritten. `seconds` of real time may
    pass. Returns part of a sentence, empty if nothing could be seen.
    """
    fine = go_on(assembly, control, course, seconds, cancel, every_step=True)
    if fine is None or len(fine.time) < 3:
        return ""
    trial = (assembly, control, course, seconds, cancel)
    if trembling := _trembling(mechanism, fine, *trial):
        return trembling
    dominant = dominant_motion(assembly, control, fine.twist, fine.own)
    onward = go_on(*trial)
    if onward is None or len(onward.time) < 3:
        return _motion(mechanism, assembly, dominant, "goes on")
    if trembling := _trembling(mechanism, onward.last(FINE), *trial):
        return trembling
    dominant = dominant_motion(assembly, control, onward.twist, onward.own)
    if onward.rested is not None:
        return f"{_motion(mechanism, assembly, dominant, 'still moves')}; " + _longer(mechanism, onward.rested, "comes")
    speeds = speed_trend(onward.time, dominant.speed, control.window, control.drift)
    loaded = _is_loaded(assembly, dominant, course)
    return "; ".join([_motion(mechanism, assembly, dominant, speeds.kind, loaded), *_advice(mechanism, speeds, loaded)])


def unheld(mechanism: Mechanism, pose: Assembly, control: Control) -> str:
    """Describe which body starts to move at a pose, as `forces_at_rest` left it, that no contact forces hold."""
    motion = _begun(mechanism, pose, control, pose.state.v, "begins")
    return f"no contact forces hold the pose: {motion}" if motion else ""


def flight(mechanism: Mechanism, pose: Assembly, control: Control, twist: Array) -> str:
    """Describe which body is in flight at the end of a run, with the ``twist`` of `in_flight`; empty if none is."""
    motion = _begun(mechanism, pose, control, twist, "flies")
    return f"{motion}, and no contact, joint or spring holds it" if motion else ""


def _begun(mechanism: Mechanism, pose: Assembly, control: Control, twist: Array, kind: str) -> str:
    """Describe the motion of the body that moves most with these twists, shape (nb + 1, 6)."""
    spin = np.einsum("bij,bj->bi", pose.state.R[:-1], twist[:-1, 3:])
    motion = np.concatenate([twist[:-1, :3], spin], axis=1)[None]
    if not motion.any():
        return ""
    return _motion(mechanism, pose, dominant_motion(pose, control, motion, motion), kind)


def _motion(mechanism: Mechanism, assembly: Assembly, dominant: DominantMotion, kind: str, loaded: bool = True) -> str:
    """Describe the body, direction and speed of a motion; without the speed if ``kind`` is "begins"."""
    body, length, time = order_bodies(mechanism)[dominant.body], mechanism.unit("length"), mechanism.unit("time")
    R, moves, turns = assembly.state.R[dominant.body], dominant.along @ dominant.along, dominant.about @ dominant.about
    to_and_fro = kind in ("swings", "trembles")
    speed = float(np.abs(dominant.speed).max() if to_and_fro else abs(dominant.speed[0]))
    before = " at up to " if to_and_fro else " at "
    slides = "" if kind == "begins" else f"{before}{speed * math.sqrt(moves):.3g} {length}/{time}"
    spins = "" if kind == "begins" else f"{before}{speed * math.sqrt(turns) / dominant.arm:.3g} rad/{time}"
    if not turns > PURE:
        along = direction_words(mechanism, body, R, dominant.along, signed=not to_and_fro)
        verb = kind if to_and_fro or kind == "flies" else "slides" if loaded else "floats"
        return f"{body} {verb} along {along}{slides}"
    verb, about = kind if to_and_fro else "turns", direction_words(mechanism, body, R, dominant.about, signed=False)
    if not moves > PURE or _is_hinged(mechanism, body, R, dominant.along, dominant.about / dominant.arm):
        return f"{body} {verb} about {about}{spins}"
    along = direction_words(mechanism, body, R, dominant.along, signed=not to_and_fro)
    return f"{body} moves along {along}{slides} and {verb} about {about}{spins}"


def _is_hinged(mechanism: Mechanism, body: str, rotation: Array, velocity: Array, spin: Array) -> bool:
    """Return whether a joint of the body lies on the axis of its motion."""
    points = [point for _, point, _ in joint_lines(mechanism, body, rotation)]
    least = HINGED * np.linalg.norm(velocity)
    return any(np.linalg.norm(velocity + np.cross(spin, point)) < least for point in points)


def _is_loaded(assembly: Assembly, dominant: DominantMotion, course: Course) -> bool:
    """Return whether a load acts on the body along its motion."""
    model, state, work, body = assembly.model, assembly.state, assembly.work, dominant.body
    phase, t = int(course.counts[time_loop.PHASE]), float(course.reals[time_loop.TIME])
    apply_loads(model.bodies, model.loads, model.time_laws, state, phase, t, work.wrench, work.vectors)
    forces, torques = work.wrench[:-1, :3], work.wrench[:-1, 3:] / dominant.arm
    size = np.sqrt((forces**2).sum(axis=1) + (torques**2).sum(axis=1)).max()
    along = forces[body] @ dominant.along + torques[body] @ dominant.about
    return bool(abs(along) > NO_LOAD * size)


def _advice(mechanism: Mechanism, speeds: SpeedTrend, loaded: bool) -> Iterator[str]:
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
    dominant = dominant_motion(assembly, control, onward.twist, onward.own)
    span = float(onward.time[-1] - onward.time[0])
    if onward.rested is not None or span > 2 * FINE * control.longest:  # a slow motion to and fro, not trembling
        return ""
    if len(turns_of(dominant.speed)) < TREMBLES and not (
        _stays(onward, dominant, span) and alternating_contacts(assembly, onward)
    ):
        return ""
    advice = _shorter_step(mechanism, assembly, control, course, seconds, cancel) or _places(assembly, onward)
    return f"{_motion(mechanism, assembly, dominant, 'trembles')}; {advice}"


def _stays(onward: Continuation, dominant: DominantMotion, span: float) -> bool:
    """Return whether the body gets nowhere at its speed, because the projection undoes the motion of each step."""
    moved = onward.place[-1, dominant.body, :3] - onward.place[0, dominant.body, :3]
    went = float(np.abs(dominant.speed).mean()) * math.hypot(*dominant.along) * span
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
    if names := alternating_contacts(assembly, onward):
        which, needs = ("contact", "it needs") if len(names) == 1 else ("contacts", "they need")
        places = f"{which} {', '.join(names)} would have to hold at two places at once, and a contact acts at one point"
        return f"{places}: {needs} a contact for each, such as two planes in place of a groove"
    return "it changes its direction within a few steps: a shorter simulation.step may help"


def direction_words(mechanism: Mechanism, body: str, rotation: Array, direction: Array, signed: bool = True) -> str:
    """Return a direction of any length in world axes in words, such as ``"-z, the axis of J1"``; axes are unsigned."""
    unit = direction / np.linalg.norm(direction)
    largest = int(np.abs(unit).argmax())
    joints = [name for name, _, axis in joint_lines(mechanism, body, rotation) if abs(axis @ unit) > PARALLEL]
    named = f"the axis of {' and '.join(joints)}" if joints else ""
    if abs(unit[largest]) > PARALLEL:
        sign = ("-" if unit[largest] < 0 else "+") if signed else ""
        return ", ".join(filter(None, (f"{sign}{'xyz'[largest]}", named)))
    unit = unit if signed or unit[largest] > 0.0 else -unit
    components = ", ".join(f"{round(float(x), 3) + 0.0:g}" for x in unit)
    return named or f"({components})"


def motion_words(mechanism: Mechanism, body: str, rotation: Array, velocity: Array, spin: Array) -> str:
    """Return a body's motion to and fro, given in world axes, in words: along a direction, about an axis, or both."""
    about = f"about {direction_words(mechanism, body, rotation, spin, signed=False)}" if spin.any() else ""
    if about and (not velocity.any() or _is_hinged(mechanism, body, rotation, velocity, spin)):
        return about
    along = f"along {direction_words(mechanism, body, rotation, velocity, signed=False)}"
    return f"{along} and {about}" if about else along


def joint_lines(mechanism: Mechanism, body: str, rotation: Array) -> Iterator[tuple[str, Array, Array]]:
    """Yield the joints of a body that have an axis: name, point from the centre of mass, unit axis; in world axes."""
    centre, scale = np.array(mechanism.bodies[body].center_of_mass), mechanism.stretch(body)
    for name, joint in mechanism.joints.items():
        own = [
            (side.place, axis) for side, axis in zip(joint.sides, joint.axes or (), strict=False) if side.body == body
        ]
        for place, axis in own[:1]:
            vector = np.array(axis, float)
            yield name, scale * rotation @ (np.array(place) - centre), rotation @ (vector / np.linalg.norm(vector))


def in_flight(assembly: Assembly, pose: Assembly, least: float) -> Array:
    """Return the twists, shape (nb + 1, 6), of bodies in flight while all measured is at rest; zero for all others.

    Bodies connected by joints, springs, loaded contacts, friction of joints that stick, or motions form a group. A
    group without such a link to the ground is in flight if a load moves its centre of mass in a direction that joints
    to the ground allow. Without a load it is in flight if it moves faster than ``least`` [length/time] in a direction
    that these joints allow, and closes no gap in doing so: a part that floats in its play will meet the other side.

    `pose` is a copy of the assembly as `engine.equilibrium.forces_at_rest` left it.
    """
    model, velocity, forces = assembly.model, assembly.state.v[:-1, :3], pose.work.wrench[:-1, :3]
    found = np.zeros_like(assembly.state.v)
    root = np.empty(len(found), np.int64)
    link_bodies(model, assembly.state, least, root)
    for number in np.unique(root[root != root[-1]]):
        group = root[:-1] == number
        mean = np.average(velocity[group], axis=0, weights=model.bodies.mass[group])
        load = _allowed(pose, group, forces[group].sum(axis=0))
        falls = np.linalg.norm(load) > LOADED * np.abs(forces[group]).max()
        if falls or (np.linalg.norm(mean) > least and _goes_on(pose, group, mean)):
            found[:-1, :3][group] = mean if mean.any() else load
    return found


def _slides(pose: Assembly, group: Chosen) -> Array:
    """Return the directions, shape (n, 3), in which joints hold points of a group."""
    rows, own = pose.model.bilateral, np.append(group, False)
    slides = rows.acts & (rows.kind == SLIDE) & (own[rows.a] != own[rows.b])
    return np.asarray(pose.work.bilateral.direction[slides])


def _allowed(pose: Assembly, group: Chosen, vector: Array) -> Array:
    """Return the component of a vector along which joints let a group move."""
    _, sizes, directions = np.linalg.svd(_slides(pose, group))
    held = directions[: int((sizes > HELD).sum())]
    return np.asarray(vector - held.T @ (held @ vector))


def _goes_on(pose: Assembly, group: Chosen, velocity: Array) -> bool:
    """Return whether a group can continue with this velocity: joints to the ground allow it, and it closes no gap."""
    contacts, own, held = pose.model.contacts, np.append(group, False), HELD * float(np.linalg.norm(velocity))
    opens = (own[contacts.a].astype(float) - own[contacts.b]) * (pose.work.sites.frame[:, 0] @ velocity)
    return bool((np.abs(_slides(pose, group) @ velocity) <= held).all() and (opens >= -held).all())
