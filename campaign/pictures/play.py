"""The positions of journals in their bearings: the play of a joint, magnified so that its clearance is 1."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from campaign.pictures.poses import Pose
from campaign.pictures.view import View
from engine import Mechanism
from engine.arrays import Array


@dataclass(frozen=True)
class Play:
    """The positions of a journal's axis in the rings of its bearing, or of a ball in its socket, at ``m`` instants."""

    joint: str
    clearance: float  # radius of the circle that limits the axis [length]
    eccentricity: Array  # (m, rings, 2), from the bearing's axis to the journal's, in clearances, along `across`
    across: Array  # (m, 2, 3), unit vectors across the joint's axis in the world, to the right and up in the picture


def plays(mechanism: Mechanism, body_poses: dict[str, Pose], view: View) -> Iterator[Play]:
    """Yield the play of every joint with a circle of clearance (not of the block of a slot) at ``m`` instants."""
    for name, joint in mechanism.joints.items():
        clearance = getattr(joint, joint.CLEARANCE) if joint.CLEARANCE and not joint.ideal else None
        stations = _stations(joint)
        if not clearance or not len(stations):
            continue
        outer, inner = joint.sides
        centre = body_poses[inner.body].world(np.array([inner.point]))
        if joint.axes is None:
            offset = centre - body_poses[outer.body].world(np.array([outer.point]))
            across = np.tile([view.right, view.up], (len(offset), 1, 1))
            yield Play(name, clearance, view.project(offset) / clearance, across)
            continue
        rings = np.array(outer.point) + np.outer(stations, joint.axes[0])
        offset = centre - body_poses[outer.body].world(rings)
        axis = body_poses[inner.body].direction(np.array(joint.axes[1]))[:, None]
        offset -= np.sum(offset * axis, axis=-1, keepdims=True) * axis
        across = _across(axis[:, 0], view)
        yield Play(name, clearance, np.einsum("mri,mki->mrk", offset, across) / clearance, across)


def _stations(joint: Any) -> tuple[float, ...]:
    """Return the stations of the rings along the axis; one for a ball."""
    if joint.axes is None:
        return (0.0,)
    rings: tuple[float, ...] | None = getattr(getattr(joint, "shaft", joint), "rings", None)
    return rings or ()


def _across(axis: Array, view: View) -> Array:
    """Return two unit vectors across each axis, shape (m, 2, 3), as near as possible to the view's right and up."""
    candidates = sorted((view.right, view.up, view.normal), key=lambda v: round(abs(float(axis[0] @ v)), 3))[:2]
    ordered = [v for v in (view.right, view.up, view.normal) if any(v is c for c in candidates)]
    first = ordered[0] - (axis @ ordered[0])[:, None] * axis
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axis, first)
    return np.stack([first, second * np.sign(second @ ordered[1])[:, None]], axis=1)
