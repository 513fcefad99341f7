"""Where journals are in their bearings: the play of a joint, magnified until its clearance is 1."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from campaign.pictures.poses import Pose
from campaign.pictures.view import Array, View
from engine import Mechanism


@dataclass(frozen=True)
class Play:
    """The way of a journal's axis in the rings of its bearing, or of a ball's centre in its socket.

    Attributes
    ----------
    joint : name
    clearance : radius of the circle it moves in [length]
    way : (m, rings, 2) divided by the clearance, as seen across the joint's axis
    across : (m, 2, 3) the two directions in the world that are its right and up
    """

    joint: str
    clearance: float
    way: Array
    across: Array


def plays(mechanism: Mechanism, at: dict[str, Pose], view: View) -> Iterator[Play]:
    """Yield the play of every joint that has a circle of clearance; the block of a slot has none."""
    for name, joint in mechanism.joints.items():
        clearance = getattr(joint, joint.CLEARANCE) if joint.CLEARANCE and not joint.ideal else None
        stations = _stations(joint)
        if not clearance or not len(stations):
            continue
        outer, inner = joint.sides
        centre = at[inner.body].world(np.array([inner.point]))
        if joint.axes is None:
            away = centre - at[outer.body].world(np.array([outer.point]))
            across = np.tile([view.right, view.up], (len(away), 1, 1))
            yield Play(name, clearance, view.project(away) / clearance, across)
            continue
        rings = np.array(outer.point) + np.outer(stations, joint.axes[0])
        away = centre - at[outer.body].world(rings)
        axis = at[inner.body].direction(np.array(joint.axes[1]))[:, None]
        away -= np.sum(away * axis, axis=-1, keepdims=True) * axis
        across = _across(axis[:, 0], view)
        yield Play(name, clearance, np.einsum("mri,mki->mrk", away, across) / clearance, across)


def _stations(joint: Any) -> tuple[float, ...]:
    """Return the stations of the rings along the axis; one for a ball."""
    if joint.axes is None:
        return (0.0,)
    rings: tuple[float, ...] | None = getattr(getattr(joint, "shaft", joint), "rings", None)
    return rings or ()


def _across(axis: Array, view: View) -> Array:
    """Return two unit vectors across each axis, shape (m, 2, 3), as near as can be to the view's right and up."""
    candidates = sorted((view.right, view.up, view.normal), key=lambda v: round(abs(float(axis[0] @ v)), 3))[:2]
    ordered = [v for v in (view.right, view.up, view.normal) if any(v is c for c in candidates)]
    first = ordered[0] - (axis @ ordered[0])[:, None] * axis
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axis, first)
    return np.stack([first, second * np.sign(second @ ordered[1])[:, None]], axis=1)
