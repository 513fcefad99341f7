"""Bodies in flight while everything measured is at rest: they fall, or continue at a constant speed.

A part without load that floats in its play does not count: it will meet the other side.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array
from engine.assembly import Assembly
from engine.kernels.model import SLIDE, Model

Chosen = NDArray[np.bool_]

HELD = 1e-9  # share of a group's speed at which a joint or a gap may still change
LOADED = 1e-6  # share of the largest load below which a load counts as zero


def in_flight(assembly: Assembly, pose: Assembly, least: float) -> Array:
    """Return the twists, shape (nb + 1, 6), of bodies in flight; zero for all others.

    Bodies connected by joints, springs, loaded contacts or motions form a group. A group without such a link to the
    ground is in flight if a load moves its centre of mass in a direction that joints to the ground allow. Without a
    load it is in flight if it moves faster than ``least`` in a direction that these joints allow, and closes no gap in
    doing so.

    `pose` is a copy of the assembly as `engine.equilibrium.forces_at_rest` left it: loads, and frames of contacts and
    rows at that pose. `least` is a speed [length/time].
    """
    model, velocity, forces = assembly.model, assembly.state.v[:-1, :3], pose.work.wrench[:-1, :3]
    found = np.zeros_like(assembly.state.v)
    for group in _groups(model, assembly.state.r[:, 0] > 0.0):
        mean = np.average(velocity[group], axis=0, weights=model.bodies.mass[group])
        load = _allowed(pose, group, forces[group].sum(axis=0))
        falls = np.linalg.norm(load) > LOADED * np.abs(forces[group]).max()
        if falls or (np.linalg.norm(mean) > least and _goes_on(pose, group, mean)):
            found[:-1, :3][group] = mean if mean.any() else load
    return found


def _groups(model: Model, loaded: Chosen) -> Iterator[Chosen]:
    """Yield the groups of bodies, each a mask of shape (nb,), that are linked to one another and not to the ground.

    An ideal joint to the ground is not such a link, because it may allow the motion. Neither is a spring that only
    pushes.
    """
    rows, loads, contacts, ground = model.bilateral, model.loads, model.contacts, len(model.bodies.mass)
    ends = np.stack([rows.a, rows.b], axis=1)
    between = rows.acts & (ends != ground).all(axis=1)
    driven = ends[rows.acts & (rows.law >= 0)].ravel()
    member = np.arange(ground + 1)
    for a, b in np.concatenate(
        [
            ends[between],
            np.stack([driven, np.full_like(driven, ground)], axis=1),
            loads.spring_body[loads.spring_law[:, 4] <= 0.0],
            np.stack([contacts.a, contacts.b], axis=1)[loaded],
        ]
    ):
        # all of one group take the number of the other: at the end, equal numbers are linked
        member[member == member[a]] = member[b]
    for number in np.unique(member):
        if number != member[ground]:
            yield member[:-1] == number


def _slides(pose: Assembly, group: Chosen) -> Array:
    """Return the directions, shape (n, 3), in which joints hold points of a group."""
    rows, own = pose.model.bilateral, np.append(group, False)
    slides = rows.acts & (rows.kind == SLIDE) & (own[rows.a] != own[rows.b])
    return np.asarray(pose.work.bilateral.direction[slides])


def _allowed(pose: Assembly, group: Chosen, vector: Array) -> Array:
    """Return the component of a vector along which joints let a group move."""
    _, sizes, directions = np.linalg.svd(_slides(pose, group))
    held = directions[: int((sizes > HELD).sum())]
    return np.asarray(vector - held.T @ (held @ vector))


def _goes_on(pose: Assembly, group: Chosen, velocity: Array) -> bool:
    """Return whether a group can continue with this velocity: joints to the ground allow it, and it closes no gap."""
    contacts, own, held = pose.model.contacts, np.append(group, False), HELD * float(np.linalg.norm(velocity))
    opens = (own[contacts.a].astype(float) - own[contacts.b]) * (pose.work.sites.frame[:, 0] @ velocity)
    return bool((np.abs(_slides(pose, group) @ velocity) <= held).all() and (opens >= -held).all())
