"""The convex programme behind an allocation: minimise ``sum b_i / t_i`` with ``C t^2 <= room`` and bounds on t."""

from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array

# Shares of a bound or of the room within which a constraint counts as active.
_ACTIVE = 1e-7


@dataclass(frozen=True)
class Optimum:
    """The cheapest tolerances.

    Attributes
    ----------
    tolerance : array, shape (k,)
    price : array, shape (r,)
        Multiplier of each response: cost saved per unit of additional room.
    """

    tolerance: Array
    price: Array


def cheapest(cost: Array, rate: Array, room: Array, lower: Array, upper: Array) -> Optimum | None:
    """Return the cheapest tolerances; None if none within the bounds fit.

    In ``u = (t / upper)^2`` the cost is convex and the constraints are linear, so the optimum is the only one.

    Parameters
    ----------
    cost : array, shape (k,)
        b of each variable, above 0.
    rate : array, shape (r, k)
        Variance of each response for a unit of squared tolerance, not negative.
    room : array, shape (r,)
        Variance each response may have from these variables.
    lower, upper : array, shape (k,)
        Bounds of the tolerances, above 0; equal for a locked variable.
    """
    from scipy.optimize import minimize  # takes 0.4 s to import, which `import reporting` avoids

    if np.any(rate @ lower**2 > room):
        return None
    # In shares of what the bounds and the room allow each variable alone, everything is of order one.
    with np.errstate(divide="ignore", invalid="ignore"):
        alone = np.sqrt(np.min(np.where(rate > 0, room[:, None] / rate, np.inf), axis=0))
    most, scale = np.maximum(np.minimum(upper, alone), lower), np.where(room > 0, room, 1.0)
    low, load = (lower / most) ** 2, rate * most**2 / scale[:, None]
    weight = cost / most / np.sum(cost / most)
    optimum = minimize(
        lambda u: float(np.sum(weight * u**-0.5)),
        np.maximum(low, 1 / low.size),
        jac=lambda u: -0.5 * weight * u**-1.5,
        method="SLSQP",
        bounds=np.column_stack([low, np.ones_like(low)]),
        constraints={"type": "ineq", "fun": lambda u: room / scale - load @ u, "jac": lambda _: -load},
        options={"ftol": 1e-16, "maxiter": 500},
    )
    tolerance = np.clip(most * np.sqrt(np.clip(optimum.x, low, 1.0)), lower, upper)
    return Optimum(tolerance, _prices(tolerance, cost, rate, room, lower, upper))


def _prices(tolerance: Array, cost: Array, rate: Array, room: Array, lower: Array, upper: Array) -> Array:
    """Return the multipliers of the responses from the conditions of Karush, Kuhn and Tucker at the optimum.

    The slope of the cost is balanced by the active constraints, each with a multiplier that is not negative.
    """
    from scipy.optimize import nnls  # see `cheapest`

    active = room - rate @ tolerance**2 <= _ACTIVE * room
    at_upper, at_lower = tolerance > upper * (1 - _ACTIVE), tolerance < lower * (1 + _ACTIVE)
    unit = np.sum(cost / tolerance) / np.where(room > 0, room, 1.0)
    slopes = 2 * tolerance**3 / cost * rate[active] * unit[active, None]
    bounds = np.eye(tolerance.size)
    multipliers, _ = nnls(np.hstack([slopes.T, bounds[:, at_upper], -bounds[:, at_lower]]), np.ones(tolerance.size))
    price = np.zeros(room.size)
    price[active] = multipliers[: np.count_nonzero(active)]
    return price * unit
