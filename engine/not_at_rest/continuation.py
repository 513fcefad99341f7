"""Continue a run beyond its horizon, step by step, to see what the mechanism does.

The motion seen has a dominant direction, its speed a trend, and some contacts press alternately at two places.

Only runs that did not come to rest are continued, on copies of their arrays, by the same time loop.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array, Integers, copied
from engine.assembly import Assembly
from engine.assembly.frames import rotate
from engine.kernels import time_loop
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.model import ANGLE, GAP, POSITION, Control, Model, RunArrays
from engine.kernels.record import BODY, CONTACT, HEAD, row_length
from engine.kernels.rest import LOADED
from engine.kernels.time_loop import Course, run_to_end
from engine.kernels.vectors import rotation_matrix
from engine.loop import Cancel, limited

FEWEST, MOST = 500, 8000  # steps of a continuation
NUMBERS = 1_000_000  # of a continuation that are kept in memory
FINE = 64  # number of steps that are all kept, to detect trembling

STEADY = 0.02  # relative change of the speed over the time observed, below which it is steady
LINEAR = 0.8  # share of the first half's loss of speed that the second half repeats; with dry friction it is 1

UNSEEN = 1e-12  # share of the squared largest speed below which there is no motion

APART = 0.1  # between the unit normals of two places; a body that rolls or slides on one face turns far less in a step
OFTEN = 4  # changes from one place to the other within a continuation that keeps every step


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
    """Continue the phase in which a run reached its horizon, without changing the run; the horizon itself is not used.

    With `every_step` few steps are made and each is kept; otherwise twice as many as the run made, of which some are
    kept. None if it was cancelled, took longer than `seconds` of real time, or a step failed.
    """
    end, steps = float(course.reals[time_loop.TIME]), int(course.counts[time_loop.ACCEPTED])
    most = FINE if every_step else min(max(2 * steps, FEWEST), MOST)
    length = row_length(len(assembly.model.bodies.mass), len(assembly.contact_names), len(assembly.work.values))
    kept = FINE if every_step else max(min(most, NUMBERS // length), FINE)
    stride = -(-most // kept)
    arrays, course = copy_of(assembly.arrays, int(course.counts[time_loop.PHASE])), Course(*map(np.copy, course))
    beyond = end + most * control.longest
    course.reals[time_loop.PHASE_END] = beyond
    # a trial with a shorter step must not begin with the step of the run
    course.reals[time_loop.STEP] = min(course.reals[time_loop.STEP], control.longest)
    course.reals[time_loop.LONGEST] = min(course.reals[time_loop.LONGEST], control.longest)
    course.counts[time_loop.ACCEPTED] = 0
    rows = np.zeros((kept + 2, length))
    with limited(cancel, seconds) as stop:
        run_to_end(
            arrays, control._replace(horizon=beyond, full_horizon=False, lost=np.inf), course, rows, stride, stop
        )
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


def copy_of(arrays: RunArrays, phase: int) -> RunArrays:
    """Return copies of all arrays that a run writes; such a run ends with the current phase."""
    model, state, work, problem = arrays
    phases = model.phases._replace(**{name: x[: phase + 1] for name, x in model.phases._asdict().items()})
    laws = model.time_laws._replace(begun=model.time_laws.begun.copy())
    rows = model.bilateral._replace(offset=model.bilateral.offset.copy(), acts=model.bilateral.acts.copy())
    model = Model(**{**model._asdict(), "phases": phases, "time_laws": laws, "bilateral": rows})
    return RunArrays(model, copied(state), copied(work), problem)


# How a speed develops: to rest, to and fro, slower and slower, steadily, or ever faster.


@dataclass(frozen=True)
class SpeedTrend:
    """How a speed develops."""

    # swings to and fro, turns back once, slows down, is steady, or gets faster
    kind: Literal["swings", "turns back", "slows", "steady", "faster"]
    rest: float | None = None  # time at which it is expected to come to rest, if this can be told
    period: float | None = None  # for a swing
    loss: float | None = None  # for a swing, the share of its amplitude lost per period, if more than one was seen


def speed_trend(time: Array, speed: Array, window: float, drift: float) -> SpeedTrend:
    """Return how a speed, shape (n,), n >= 3, develops; what moves by at most `drift` in a `window` is at rest."""
    turns = turns_of(speed)
    if turns.size:
        return _swing(time, speed, turns, window, drift)
    first, middle, last = np.interp([time[0], 0.5 * (time[0] + time[-1]), time[-1]], time, np.abs(speed))
    if abs(last - first) <= STEADY * max(first, last):
        return SpeedTrend("steady")
    if last > first:
        return SpeedTrend("faster")
    return SpeedTrend("slows", _stop(time, first, middle, last, drift / window))


def turns_of(speed: Array) -> Integers:
    """Return the indices of the values after which a speed changes its sign."""
    return np.flatnonzero(np.sign(speed[:-1]) * np.sign(speed[1:]) < 0.0)


def _stop(time: Array, first: float, middle: float, last: float, slow: float) -> float | None:
    """Return when a falling speed will be below ``slow``: falling linearly, or by equal shares in equal times."""
    half, ratio = 0.5 * (time[-1] - time[0]), (middle - last) / (first - middle) if first > middle else np.inf
    if ratio > 1.0 / LINEAR:
        return None  # it falls faster and faster and will soon reverse
    if ratio >= LINEAR:
        return float(time[-1] + max(last - slow, 0.0) / (middle - last) * half)
    level = last - (middle - last) * ratio / (1.0 - ratio)  # its limit
    if level >= slow:
        return None
    return float(time[-1] + half * max(np.log((slow - level) / (last - level)) / np.log(ratio), 0.0))


def _swing(time: Array, speed: Array, turns: Integers, window: float, drift: float) -> SpeedTrend:
    """Return the period and loss of a speed that changes its sign, and when it will be at rest."""
    zeros = time[turns] + (time[turns + 1] - time[turns]) * speed[turns] / (speed[turns] - speed[turns + 1])
    if turns.size < 2:
        return SpeedTrend("turns back")
    half = float(np.diff(zeros).mean())
    tops = np.array([np.abs(speed[a + 1 : b + 1]).max() for a, b in pairwise(turns)])
    if tops.size < 2:
        return SpeedTrend("swings", None, 2 * half)
    left = float((tops[-1] / tops[0]) ** (1.0 / (tops.size - 1)))
    loss = 1.0 - left**2  # a period is two halves
    if loss <= STEADY:
        return SpeedTrend("swings", None, 2 * half, max(loss, 0.0))
    # a swing shorter than the window moves by 2 half / pi times its top speed, and never further
    slow = max(drift / window, drift * np.pi / (2 * half))
    halves = max(np.log(slow / tops[-1]) / np.log(left), 0.0)
    return SpeedTrend("swings", float(zeros[-1] + halves * half), 2 * half, loss)


# The body that moves most, and its motion as one coordinate: a displacement, a turn, or both.


@dataclass(frozen=True)
class DominantMotion:
    """A body's motion along its principal direction; `along` and `about` have lengths whose squares add up to 1."""

    body: int  # number in the arrays
    along: Array  # (3,), displacement of the centre of mass, in world axes
    about: Array  # (3,), rotation times `arm`, in world axes
    arm: float  # radius of gyration [length]
    speed: Array  # (n,), at the times of the continuation [length/time]; positive on average


def dominant_motion(assembly: Assembly, control: Control, twist: Array, own: Array) -> DominantMotion:
    """Return the motion of the fastest body among those that keep the mechanism from rest, or of all if these rest.

    The motion since the end of the run is given in world axes (`twist`) and in body axes (`own`), both (n, nb, 6), see
    `Continuation`: a sliding body keeps its direction in world axes, one that turns far keeps it in body axes.
    """
    bodies = assembly.model.bodies
    arms = np.sqrt(np.trace(bodies.inertia, axis1=1, axis2=2) / (2 * bodies.mass))
    # divided by the largest number, whose square may overflow for a runaway body
    squares = ((twist[..., :3] / np.abs(twist).max()) ** 2).sum(axis=2).mean(axis=0)
    squares += ((twist[..., 3:] / np.abs(twist).max() * arms[:, None]) ** 2).sum(axis=2).mean(axis=0)
    watched = np.where(_restless(assembly, control), squares, 0.0)
    body = int((watched if watched.max() > UNSEEN * squares.max() else squares).argmax())
    scale = np.repeat([1.0, arms[body]], 3)
    in_world, in_body = (_principal(motion[:, body] * scale) for motion in (twist, own))
    share, direction, speed = max(in_world, in_body, key=lambda found: found[0])
    if share > in_world[0]:
        direction = (assembly.state.R[body] @ direction.reshape(2, 3, 1)).ravel()
    return DominantMotion(body, direction[:3], direction[3:], float(arms[body]), speed)


def _principal(motion: Array) -> tuple[float, Array, Array]:
    """Return the principal direction of a motion, (n, 6): its share of the mean square, itself, and the speed, > 0."""
    largest = np.abs(motion).max()
    sizes, directions = np.linalg.eigh(np.einsum("ti,tj->ij", motion / largest, motion / largest))
    direction = directions[:, -1]
    speed = motion @ direction
    sign = -1.0 if speed.sum() < 0.0 else 1.0
    # rounded, so that of two equal shares `dominant_motion` takes the first, that in world axes
    return round(float(sizes[-1] / sizes.sum()), 9), sign * direction, sign * speed


def _restless(assembly: Assembly, control: Control) -> NDArray[np.bool_]:
    """Return which bodies a response at the end measures, or slip under load; if there are none, all bodies."""
    model, state = assembly.model, assembly.state
    responses, contacts, nb = model.responses, model.contacts, len(model.bodies.mass)
    found = np.zeros(nb + 1, bool)
    moved = responses.measures_motion
    for kind, bodies in zip(responses.kind[moved], responses.body[moved], strict=True):
        if kind == GAP:
            found[[contacts.a[bodies[0]], contacts.b[bodies[0]]]] = True
        elif kind == POSITION:
            found[bodies] = True
        elif kind == ANGLE:
            found[bodies[:2]] = True
    loaded = state.r[:, 0] > LOADED * state.r[:, 0].max(initial=0.0)
    slips = loaded & (state.slip * control.window > control.drift)
    found[contacts.a[slips]] = found[contacts.b[slips]] = True
    return found[:nb] if found[:nb].any() else np.ones(nb, bool)


def alternating_contacts(assembly: Assembly, onward: Continuation) -> list[str]:
    """Return the contacts that press alternately at two places, and cannot hold at both; `onward` has every step."""
    normals, names = _normals(assembly, onward), []
    for c, name in enumerate(assembly.contact_names):
        pressing = normals[onward.impulse[:, c] > 0.0, c]
        changes = sum(bool(np.linalg.norm(one - other) > APART) for one, other in pairwise(pressing))
        if changes >= OFTEN:
            names.append(name)
    return names


def _normals(assembly: Assembly, onward: Continuation) -> Array:
    """Return the normals of all contacts in world axes, shape (n, nc, 3)."""
    state, work = copied(assembly.state), copied(assembly.work)
    sites, bodies = work.sites, onward.place.shape[1]
    normals = np.empty((len(onward.time), len(assembly.contact_names), 3))
    for at, place in enumerate(onward.place):
        state.x[:bodies] = place[:, :3]
        for body in range(bodies):
            rotation_matrix(place[body, 3:], state.R[body])
        find_contacts(assembly.model.contacts, state.x, state.R, work.gap, sites.point, sites.frame)
        normals[at] = sites.frame[:, 0]
    return normals
