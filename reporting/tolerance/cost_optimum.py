"""The convex programme behind an allocation: minimise ``sum b_i / t_i`` with ``C t^2 <= room`` and bounds on t."""

from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array

_GAP = 1e-11  # of the cost, at which the optimum is found
_STEEPER = 8.0
_NEWTON_STEPS = 60
_SAME = 1e-12  # bounds this close leave nothing to choose


@dataclass(frozen=True)
class Optimum:
    """The optimum: tolerances (k,), and the multiplier of each response, cost per unit of room (r,)."""

    tolerance: Array
    price: Array


def cheapest(cost: Array, rate: Array, room: Array, lower: Array, upper: Array) -> Optimum | None:
    """Return the cheapest tolerances, or None where none within the bounds fit.

    Parameters
    ----------
    cost : array, shape (k,)
        b of each joint, above 0.
    rate : array, shape (r, k)
        Variance of each response for a unit of squared tolerance, not negative.
    room : array, shape (r,)
        Variance each response may have from these joints.
    lower, upper : array, shape (k,)
        Bounds, above 0; equal where the joint is locked.
    """
    free = upper - lower > _SAME * upper
    room = room - rate[:, ~free] @ lower[~free] ** 2
    tolerance = lower.copy()
    # In shares of the upper bound and of the room, everything is of order one.
    low = (lower[free] / upper[free]) ** 2
    load = rate[:, free] * upper[free] ** 2
    if np.any(room - load @ low < 0) or np.any(room < 0):
        return None
    scale = np.where(room > 0, room, 1.0)
    weight = cost[free] / upper[free]
    bound = np.any(load > 0, axis=1)
    price = np.zeros(room.size)
    if free.any():
        total = float(weight @ low**-0.5)
        solved = _barrier(weight / total, (load / scale[:, None])[bound], low)
        if solved is None:
            return None
        share, multiplier = solved
        tolerance[free] = upper[free] * np.sqrt(share)
        price[bound] = multiplier * total / scale[bound]
    return Optimum(tolerance, price)


def _barrier(weight: Array, load: Array, low: Array) -> tuple[Array, Array] | None:
    """Minimise ``sum w u^-1/2`` with ``load u <= 1``, ``low <= u <= 1``; None where there is no room inside."""
    rows = np.concatenate([load, np.eye(low.size), -np.eye(low.size)])
    ends = np.concatenate([np.ones(load.shape[0] + low.size), -low])
    u = _inside(load, low)
    if u is None:
        return None
    sharpness = 1.0
    while True:
        for _ in range(_NEWTON_STEPS):
            slack = ends - rows @ u
            slope = -0.5 * sharpness * weight * u**-1.5 + rows.T @ (1 / slack)
            bend = np.diag(0.75 * sharpness * weight * u**-2.5) + (rows.T / slack**2) @ rows
            step = -np.linalg.solve(bend, slope)
            decrease = -float(slope @ step)
            if decrease < 1e-12:
                break
            change = rows @ step
            reach = 0.99 / max(float(np.max(change / slack)), 0.99)
            # Damped by the self-concordant bound: no line search is needed.
            damped = 1.0 if decrease < 0.06 else 1 / (1 + np.sqrt(decrease))
            u = u + min(reach, damped) * step
        if ends.size / sharpness < _GAP:
            return u, 1 / (sharpness * (ends - rows @ u)[: load.shape[0]])
        sharpness *= _STEEPER


def _inside(load: Array, low: Array) -> Array | None:
    """Return a point strictly inside, near the tight end if need be."""
    for halvings in range(1, 40):
        u = low + (1 - low) * 0.5**halvings
        if np.all(load @ u < 1):
            return u
    return None
