"""Ideal joints as bilateral rows, named JOINT.slide1, ..., JOINT.turn1, ... (paper, eqs. 14-16)."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.assembly.bilateral import BilateralRow, turning_arm
from engine.assembly.frames import BodyFrame, tangent
from engine.assembly.joints import Mate, mate
from engine.kernels.model import SLIDE, TURN
from engine.mechanism.joints import Prismatic
from engine.mechanism.models import Mechanism

# The directions along which the points are held, and those about which the bodies are held. n is the joint's axis or
# normal in the first body; e and f are perpendicular to it.
HELD = {
    "revolute": ("nef", "ef"),
    "cylindrical": ("ef", "ef"),
    "prismatic": ("ef", "efn"),
    "spherical": ("nef", ""),
    "planar": ("n", "ef"),
    "fixed": ("nef", "efn"),
}


def joint_rows(mechanism: Mechanism, frames: dict[str, BodyFrame], R: Array) -> Iterator[BilateralRow]:
    """Yield the rows of all joints: for an ideal joint, 6 minus the number of its degrees of freedom.

    A joint with play has no rows, except a shaft in a sleeve whose rotation is held. R, (nb + 1, 3, 3), holds the
    rotations at the start.
    """
    for name, joint in mechanism.joints.items():
        slides, turns = _held(joint)
        if not slides and not turns:
            continue
        place = mate(joint, frames, R)
        bodies = place.a.index, place.b.index
        way, other = _directions(joint, place)
        arm = turning_arm(mechanism, [side.body for side in joint.sides])
        for i, k in enumerate(slides):
            row = np.concatenate([place.point_a, way[k], place.point_b])
            yield BilateralRow(f"{name}.slide{i + 1}", SLIDE, *bodies, row)
        for i, k in enumerate(turns):
            d = "e" if k == "n" else "n"  # a direction perpendicular to k, which shows the rotation about k
            row = np.concatenate([way[d], way[k], other[d]])
            yield BilateralRow(f"{name}.turn{i + 1}", TURN, *bodies, row, arm=arm)


def _held(joint: Any) -> tuple[str, str]:
    """Return the directions along which and about which a joint holds."""
    if joint.ideal:
        return HELD[joint.type]
    held = isinstance(joint, Prismatic) and joint.shaft is not None and joint.shaft.turning == "held"
    return "", "n" if held else ""


def _directions(joint: Any, place: Mate) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return n, e, f in a's axes; and in b's axes, n as given in the file and e, f as they are at the start."""
    n = place.a.direction(joint.axes[0]) if joint.axes else np.array([0.0, 0.0, 1.0])
    e = tangent(n)
    way = {"n": n, "e": e, "f": np.cross(n, e)}
    other = {k: place.relative @ d for k, d in way.items()}
    if joint.axes:
        other["n"] = place.align(n, place.b.direction(joint.axes[1]))
    return way, other
