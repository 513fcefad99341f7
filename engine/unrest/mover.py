"""The body that moves most, and its motion as one coordinate: a displacement, a turn, or both."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array
from engine.assembly import Assembly
from engine.kernels.context import Control
from engine.kernels.model import ANGLE, GAP, POSITION
from engine.kernels.rest import LOADED

UNSEEN = 1e-12  # share of the squared largest speed below which there is no motion


@dataclass(frozen=True)
class Mover:
    """A body's motion along its principal direction; `along` and `about` have lengths whose squares add up to 1."""

    body: int  # number in the arrays
    along: Array  # (3,), displacement of the centre of mass, in world axes
    about: Array  # (3,), rotation times `arm`, in world axes
    arm: float  # radius of gyration [length]
    speed: Array  # (n,), at the times of the continuation [length/time]; positive on average


def find_mover(assembly: Assembly, control: Control, twist: Array, own: Array) -> Mover:
    """Return the motion of the fastest body among those that keep the mechanism from rest, or of all if these rest.

    The motion since the end of the run is given in world axes (`twist`) and in body axes (`own`), both (n, nb, 6), see
    `engine.unrest.continuation`: a sliding body keeps its direction in world axes, one that turns far keeps it in body
    axes.
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
    return Mover(body, direction[:3], direction[3:], float(arms[body]), speed)


def _principal(motion: Array) -> tuple[float, Array, Array]:
    """Return the principal direction of a motion, shape (n, 6): its share of the mean square, itself, and the speed.

    The speed is positive on average.
    """
    largest = np.abs(motion).max()
    sizes, directions = np.linalg.eigh(np.einsum("ti,tj->ij", motion / largest, motion / largest))
    direction = directions[:, -1]
    speed = motion @ direction
    sign = -1.0 if speed.sum() < 0.0 else 1.0
    # rounded, so that of two equal shares `find_mover` takes the first, that in world axes
    return round(float(sizes[-1] / sizes.sum()), 9), sign * direction, sign * speed


def _restless(assembly: Assembly, control: Control) -> NDArray[np.bool_]:
    """Return which bodies a response at the end measures, or slip under load; if there are none, all bodies."""
    model, state = assembly.model, assembly.state
    responses, contacts, nb = model.responses, model.contacts, len(model.bodies.mass)
    found = np.zeros(nb + 1, bool)
    for kind, bodies in zip(
        responses.kind[responses.measures_motion], responses.body[responses.measures_motion], strict=True
    ):
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
