"""Bushings and beams as arrays: what they do as loads, and a bilateral row for each coordinate in which they yield."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from engine.arrays import Array
from engine.assembly.bilateral import BilateralRow
from engine.assembly.frames import BodyFrame
from engine.errors import Fault, MechanismError
from engine.friction.blocks import BODY
from engine.kernels.model import SLIDE, TURN, Bushings, State
from engine.mechanism.bushings import Beam, Bushing, Yielding
from engine.mechanism.models import Mechanism

ALONG = 1e-3  # sine of the angle between a beam and its normal, below which they are parallel
SHORTEST = 1e-9  # share of the size of a mechanism's numbers: ends of a beam that are nearer coincide


@dataclass(frozen=True)
class PlacedBushing:
    """A bushing, or a beam as one at its middle."""

    name: str
    a: int  # index of a body, as is b
    b: int
    place: tuple[Array, Array]  # (3,) the points from the origins of the state's frames
    axes: Array  # (3, 3) rows x, y, z in the axes of a
    turn: Array  # (4,) quaternion; b's attitude times it equals a's where there is no torque
    law: Array  # (12,) stiffnesses, then dampings


def placed_bushings(mechanism: Mechanism, frames: dict[str, BodyFrame], state: State) -> list[PlacedBushing]:
    """Return the bushings and beams as they are at the start; raise MechanismError if a beam has no length."""
    return [
        _placed(mechanism, name, joint, frames, state)
        for name, joint in mechanism.joints.items()
        if isinstance(joint, Yielding)
    ]


def _placed(
    mechanism: Mechanism, name: str, joint: Yielding, frames: dict[str, BodyFrame], state: State
) -> PlacedBushing:
    first, second = joint.sides
    a, b = frames[first.body], frames[second.body]
    back = state.R[a.index].T
    p, q = a.point(first.point), b.point(second.point)
    length, x = 0.0, np.zeros(3)
    if isinstance(joint, Beam):
        ends = state.x[a.index] + state.R[a.index] @ p, state.x[b.index] + state.R[b.index] @ q
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if not length > SHORTEST * max(float(np.abs(end).max()) for end in ends):
            text = "its ends coincide at the start, so it has no direction; allowed: two places; move one of the points"
            fault = Fault(("joints", name, "b", "point"), text, list(second.point))
            raise MechanismError(f"{mechanism.name}: a beam without length\n  {fault}", [fault])
        x, middle = back @ (ends[1] - ends[0]) / length, 0.5 * (ends[0] + ends[1])
        p, q = back @ (middle - state.x[a.index]), state.R[b.index].T @ (middle - state.x[b.index])
    elif isinstance(joint, Bushing):
        x = a.direction(joint.axis)
    normal: Array | None = None if joint.normal is None else a.direction(joint.normal)
    y = _across(x, a.rotation.T @ x, a.rotation) if normal is None else normal - (normal @ x) * x
    size = float(np.linalg.norm(y))
    if size < ALONG:
        text = "along the beam at the start, so it leaves open how its cross-section lies; allowed: across it; turn it"
        fault = Fault(("joints", name, "normal"), text, list(joint.normal or ()))
        raise MechanismError(f"{mechanism.name}: a beam with a normal along it\n  {fault}", [fault])
    y = y / size
    pa, pb = state.p[a.index], state.p[b.index]
    turn = np.array([pb @ pa, *(pb[0] * pa[1:] - pa[0] * pb[1:] - np.cross(pb[1:], pa[1:]))])
    law = np.concatenate(joint.springs(length))
    return PlacedBushing(name, a.index, b.index, (p, q), np.array([x, y, np.cross(x, y)]), turn, law)


def _across(x: Array, own: Array, rotation: Array) -> Array:
    """Return the axis of the body's frame most across x, as far as it is; ``own`` is x in that frame."""
    e = rotation[:, np.argmin(np.abs(own).round(9))]
    return np.asarray(e - (e @ x) * x)


def bushing_arrays(bushings: Sequence[PlacedBushing]) -> Bushings:
    """Return the bushings as arrays."""
    n = len(bushings)
    return Bushings(
        body=np.array([(each.a, each.b) for each in bushings], np.int64).reshape(-1, 2),
        place=np.array([each.place for each in bushings], float).reshape(-1, 2, 3),
        axes=np.array([each.axes for each in bushings], float).reshape(-1, 9),
        turn=np.array([each.turn for each in bushings], float).reshape(-1, 4),
        law=np.array([each.law for each in bushings], float).reshape(-1, 2 * BODY),
        point=np.zeros((n, 3)),
        way=np.zeros((n, BODY, 3)),
        off=np.zeros((n, BODY)),
        effort=np.zeros((n, BODY)),
        anchor=np.zeros((n, BODY)),
    )


def bushing_rows(bushings: Sequence[PlacedBushing], phases: int) -> Iterator[BilateralRow]:
    """Yield a row for each coordinate with a stiffness or damping; they act within a step only."""
    for i, each in enumerate(bushings):
        for k in range(BODY):
            if each.law[k] or each.law[BODY + k]:
                kind, name = (SLIDE, f"slide{k + 1}") if k < 3 else (TURN, f"turn{k - 2}")
                never = np.zeros(phases, bool)
                yield BilateralRow(
                    f"{each.name}.{name}", kind, each.a, each.b, np.zeros(9), phases=never, coordinate=BODY * i + k
                )
