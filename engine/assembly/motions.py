"""Prescribed motions as bilateral rows whose target is a law of time."""

import numpy as np

from engine.assembly.frames import Frame, tangent
from engine.assembly.ties import Tie, turning_arm
from engine.kernels.model import SLIDE, TURN, State
from engine.mechanism.models import Mechanism
from engine.mechanism.motions import Translation


def motion_ties(mechanism: Mechanism, frames: dict[str, Frame], state: State, laws: dict[str, int]) -> list[Tie]:
    """Return one row for each motion, in the order of the file; at the pose of ``state`` no target is missed.

    Parameters
    ----------
    mechanism, frames, state : the description, the bodies' own frames, the start pose
    laws : each time law's number, by the key of its owner
    """
    ties = []
    for name, motion in mechanism.motions.items():
        a, b = frames[motion.relative_to or "world"].index, frames[motion.body].index
        side = frames[motion.relative_to or "world"]
        if isinstance(motion, Translation):
            along, led = side.direction(motion.along.direction), frames[motion.body].point(motion.along.point)
            start = state.R[a].T @ (state.x[b] + state.R[b] @ led - state.x[a])  # where the point is, seen from a
            row, kind, arm = [*start, *along, *led], SLIDE, 1.0
        else:
            axis = side.direction(motion.about.axis)
            mark = tangent(axis)
            row, kind, arm = (
                [*mark, *axis, *(state.R[b].T @ state.R[a] @ mark)],
                TURN,
                turning_arm(mechanism, [motion.body, *([motion.relative_to] if motion.relative_to else [])]),
            )
        ties.append(Tie(name, kind, a, b, np.array(row), arm, law=laws[f"motions.{name}"]))
    return ties
