"""Prescribed motions as bilateral rows with a time law as their target."""

import numpy as np

from engine.assembly.bilateral import BilateralRow, turning_arm
from engine.assembly.frames import BodyFrame, tangent
from engine.assembly.phases import active_phases
from engine.kernels.model import SLIDE, TURN, State
from engine.mechanism.models import Mechanism
from engine.mechanism.motions import Translation


def motion_rows(
    mechanism: Mechanism, frames: dict[str, BodyFrame], state: State, laws: dict[str, int]
) -> list[BilateralRow]:
    """Return one row per motion, in the order of the file; its violation is 0 at the pose of ``state``.

    ``laws`` gives the number of each time law by the key of its owner.
    """
    rows = []
    for key, motion in mechanism.motions.items():
        against, moved = frames[motion.relative_to or "world"], frames[motion.body]
        a, b = against.index, moved.index
        if isinstance(motion, Translation):
            along, led = against.direction(motion.along.direction), moved.point(motion.along.point)
            start = state.R[a].T @ (state.x[b] + state.R[b] @ led - state.x[a])  # position of the point seen from a
            geometry, kind, arm = [*start, *along, *led], SLIDE, 1.0
        else:
            axis = against.direction(motion.about.axis)
            mark = tangent(axis)
            geometry, kind = [*mark, *axis, *(state.R[b].T @ state.R[a] @ mark)], TURN
            arm = turning_arm(mechanism, [name for name in (motion.relative_to, motion.body) if name])
        acts = active_phases(mechanism, motion.phases)
        rows.append(BilateralRow(key, kind, a, b, np.array(geometry), arm, laws[f"motions.{key}"], acts))
    return rows
