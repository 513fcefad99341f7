"""How far friction leaves a normal force open: the range over all balanced forces inside Coulomb's cones.

At redundant contacts that stick, the same motion goes with a continuum of forces. For one contact's normal force the
ends of that continuum are two cone programmes: the forces r of all contacts are to give the same generalised impulse
H' r as a known solution, within the cones. What is left free is r = r0 + Z y, with Z a basis of the forces that balance
each other; the ends are found by Newton's method on the barrier -log(s_0^2 - |s_T|^2) of the cones, s = (mu r_N, r_T),
ever closer to their boundary (Nesterov, Nemirovskii: a path-following method).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engine.friction.problem import FrictionError

Array = NDArray[np.float64]
SLACK = 1e-8  # of the largest force: how exactly the known forces lie in their cones, and how far each is opened
FRICTIONLESS = 1e-12  # a smaller mu is none
GAP = 1e-8  # of the largest force: how exactly an end is found
SHARPER = 300.0  # from one barrier to the next
NEWTON = 60  # steps for one barrier
ROUNDING = 1e-16  # of the barrier's curvature: keeps Newton's matrix regular at the edge of sliding
ROOM = 1e4  # in largest forces: how far forces are looked for
ENDLESS = 1e-2 * ROOM  # farther away there is no end: friction wedges


class Cones(NamedTuple):
    """Forces s = start + basis y, one cone s_0 >= |s_T| for each contact; the rows s_0 of all, then s_1, then s_2."""

    start: Array  # (3 nc,)
    basis: Array  # (3 nc, d)


def normal_force_range(H: ArrayLike, mu: ArrayLike, r: ArrayLike, contact: int) -> tuple[float, float]:
    """Return the smallest and the largest normal force of one contact among all forces that balance alike.

    The largest is infinite where friction locks: two opposite walls may be pressed at will.

    Parameters
    ----------
    H : local frames, shape (3 nc, n); rows (N, T1, T2) per contact, in any metric
    mu : coefficients of friction, shape (nc,), >= 0
    r : known forces (or impulses), shape (3 nc,), inside Coulomb's cones
    contact : number of the contact asked for, 0 ... nc - 1

    Raises
    ------
    FrictionError
        If the shapes do not match, there is no such contact, or r does not lie in the cones.
    """
    H, mu, r = np.asarray(H, float), np.asarray(mu, float).ravel(), np.asarray(r, float).ravel()
    nc = mu.size
    if H.ndim != 2 or len(H) != 3 * nc or r.size != 3 * nc:
        raise FrictionError(
            f"indeterminacy: H {H.shape} and r {r.shape} with {nc} contacts; expected (3 nc, n), (3 nc,)"
        )
    if not 0 <= contact < nc:
        raise FrictionError(f"indeterminacy: contact {contact}; allowed: 0 ... {nc - 1}")
    size = float(np.abs(r).max(initial=0))
    if size == 0.0:
        return 0.0, 0.0
    outside = np.hypot(r[1::3], r[2::3]) - mu * r[::3]
    if outside.max() > SLACK**0.5 * size:
        raise FrictionError(f"indeterminacy: r of contact {int(outside.argmax())} is outside Coulomb's cone")

    cones, scale = _balanced(H, mu, r / size)
    way = cones.basis[contact] * scale[contact]
    if not np.abs(way).max(initial=0) > SLACK:
        return float(r[3 * contact]), float(r[3 * contact])
    nowhere = np.zeros(way.size)
    centre = _centred(cones, nowhere, nowhere)
    low, high = (sign * _least(cones, sign * way, centre) for sign in (1.0, -1.0))
    return max(float(r[3 * contact] + size * low), 0.0), float(r[3 * contact] + size * high)


def _balanced(H: Array, mu: Array, r: Array) -> tuple[Cones, Array]:
    """Return all forces that balance as r does, and what makes each cone's s_0 a normal force."""
    rough = mu > FRICTIONLESS
    scale = np.where(rough, 1 / np.where(rough, mu, 1.0), 1.0)
    columns = np.stack([scale, rough, rough], axis=1).ravel()  # a frictionless contact has no tangential force
    _, values, right = np.linalg.svd(np.vstack([H.T * columns, np.diag(1.0 - (columns > 0))]))
    rank = int((values > 1e-10 * values.max(initial=0)).sum())
    start = r.reshape(-1, 3) / np.where(columns > 0, columns, 1.0).reshape(-1, 3)
    start[:, 0] = np.maximum(start[:, 0], np.hypot(start[:, 1], start[:, 2])) + SLACK
    basis = right[rank:].T.reshape(mu.size, 3, -1)
    return Cones(start.T.ravel(), np.concatenate([basis[:, 0], basis[:, 1], basis[:, 2]])), scale


def _least(cones: Cones, way: Array, y: Array) -> float:
    """Return the least way . y within the cones; -inf if there is none. ``y`` is inside them."""
    weight = 1.0
    while True:
        y = _centred(cones, weight * way, y)
        if way @ y < -ENDLESS:
            return -np.inf
        if cones.start.size / weight < GAP:
            return float(way @ y)
        weight *= SHARPER


def _centred(cones: Cones, push: Array, y: Array) -> Array:
    """Return the minimum of push . y - sum log(s_0^2 - |s_T|^2), by Newton steps that stay inside the cones.

    The cone R >= |y| keeps it from running away where friction wedges.
    """
    basis, s = cones.basis, cones.start + cones.basis @ y
    signs = np.repeat((1.0, -1.0, -1.0), s.size // 3)
    value = _barrier(s, y)
    for _ in range(NEWTON):
        room = ROOM**2 - y @ y
        weight = 2 * signs / np.tile(_determinant(s, s), 3)
        slope = ((weight * s)[:, None] * basis).reshape(3, -1, y.size).sum(axis=0)  # (nc, d)
        bend = slope.T @ slope - basis.T @ (weight[:, None] * basis) + np.outer(2 * y / room, 2 * y / room)
        bend.flat[:: y.size + 1] += 2 / room + ROUNDING * bend.trace()
        down = push - slope.sum(axis=0) + 2 * y / room
        step = np.linalg.solve(bend, -down)
        decrement = float(-down @ step)
        if not decrement > 1e-3:
            return y
        ds = basis @ step
        length = min(1.0, 0.95 * _reach(s, ds)) if decrement > 0.1 else 1.0
        while True:
            after = _barrier(s + length * ds, y + length * step)
            if after + length * float(push @ step) <= value - 1e-4 * length * decrement:
                break
            length *= 0.5
            if length < 1e-12:
                return y
        y, s, value = y + length * step, s + length * ds, after
    return y


def _determinant(s: Array, t: Array) -> Array:
    """Return s_0 t_0 - s_T . t_T of every cone."""
    product = (s * t).reshape(3, -1)
    return np.asarray(product[0] - product[1] - product[2])


def _barrier(s: Array, y: Array) -> float:
    """Return the barrier; inf outside."""
    det, room = _determinant(s, s), ROOM**2 - float(y @ y)
    inside = room > 0 and det.min() > 0 and s[: det.size].min() > 0
    return -float(np.log(det).sum()) - math.log(room) if inside else math.inf


def _reach(s: Array, ds: Array) -> float:
    """Return how many times ds the forces may move until one meets the boundary of its cone."""
    a, b, c = _determinant(ds, ds), _determinant(s, ds), _determinant(s, s)
    root = np.sqrt(np.maximum(b * b - a * c, 0.0)) - b
    ahead = root > 0
    return float((c[ahead] / root[ahead]).min(initial=math.inf))  # smallest positive roots of c + 2 b x + a x^2
