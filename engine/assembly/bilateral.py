"""Bilateral rows as arrays."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Array
from engine.kernels.model import BilateralRows
from engine.mechanism.models import Mechanism


@dataclass(frozen=True)
class BilateralRow:
    """One bilateral row between two bodies (`kernels.bilateral`)."""

    name: str  # JOINT.ROW or the name of the motion, for messages
    kind: int  # SLIDE or TURN
    a: int  # index of a body, as is b
    b: int
    geometry: Array  # (9,) row of `kernels.bilateral`
    arm: float = 1.0  # length that multiplies a TURN's angle; 1 for a SLIDE
    law: int = -1  # number of the time law of its target; -1: none
    phases: Array | None = None  # (n_phase,) bool, the phases in which it acts; None: all


def turning_arm(mechanism: Mechanism, bodies: list[str]) -> float:
    """Return the length that multiplies an angle between bodies: the smallest radius of gyration of the moving ones.

    The radius is sqrt(trace(I) / 2m), the root of the mean squared distance of the body's mass from its centre.
    """
    moving = [body for body in (mechanism.bodies[name] for name in bodies) if not body.fixed]
    return float(min(np.sqrt(np.trace(np.array(b.inertia, float)) / (2 * (b.mass or 0.0))) for b in moving))


def bilateral_arrays(rows: list[BilateralRow], phases: int = 1) -> BilateralRows:
    """Return the rows as arrays, for a run of ``phases`` phases."""
    acts = np.array([np.full(phases, True) if row.phases is None else row.phases for row in rows], bool)
    acts = acts.reshape(-1, phases)
    return BilateralRows(
        kind=np.array([row.kind for row in rows], np.int64),
        a=np.array([row.a for row in rows], np.int64),
        b=np.array([row.b for row in rows], np.int64),
        geometry=np.array([row.geometry for row in rows]).reshape(-1, 9),
        arm=np.array([row.arm for row in rows], float),
        law=np.array([row.law for row in rows], np.int64),
        phase=acts,
        offset=np.zeros(len(rows)),
        acts=acts[:, 0].copy(),
    )
