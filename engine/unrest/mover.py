"""The body that moves most, and its motion as one coordinate: a displacement, a turn, or both."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Array
from engine.assembly import Assembly
from engine.kernels.context import Control
from engine.kernels.model import ANGLE, GAP, POSITION
from engine.kernels.rest import LOADED


@dataclass(frozen=True)
class Mover:
    """A body's motion along its principal direction.

    Attributes
    ----------
    body : int
        Number of the body in the arrays.
    along, about : (3,) arrays
        The direction in world axes, of which the squares of both lengths add up to 1: displacement of the centre of
        mass, and rotation times ``arm``.
    arm : float
        Radius of gyration [length].
    speed : (n,) array
        Speed along it at the times of the continuation [length/time]; positive on the whole.
    """

    body: int
    along: Array
    about: Array
    arm: float
    speed: Array


def find_mover(assembly: Assembly, control: Control, twist: Array) -> Mover:
    """Return the motion of the fastest body among those that keep the mechanism from rest.

    Parameters
    ----------
    assembly : Assembly
        As the run left it.
    control : Control
    twist : (n, nb, 6) array
        What the bodies did then, in world axes, see `engine.unrest.continuation`.
    """
    bodies = assembly.model.bodies
    arms = np.sqrt(np.trace(bodies.inertia, axis1=1, axis2=2) / (2 * bodies.mass))
    motion = twist.copy()
    motion[..., 3:] *= arms[:, None]
    squares = (motion**2).sum(axis=2).mean(axis=0)
    squares[~_restless(assembly, control)] = -1.0
    body = int(squares.argmax())
    _, directions = np.linalg.eigh(np.einsum("ti,tj->ij", motion[:, body], motion[:, body]))
    direction = directions[:, -1]
    speed = motion[:, body] @ direction
    if speed.sum() < 0.0:
        direction, speed = -direction, -speed
    return Mover(body, direction[:3], direction[3:], float(arms[body]), speed)


def _restless(assembly: Assembly, control: Control) -> Array:
    """Return which bodies a response at the end measures, or slip under load; all bodies if that is none of them."""
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
