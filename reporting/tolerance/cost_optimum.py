"""The convex programme behind an allocation: minimise the cost of the tolerances with ``C t^2 <= room`` and bounds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array
from reporting.tolerance.cost_laws import ExponentialLaw, PowerLaw

# Tolerance, as a share of a bound or of the room, within which a constraint is active.
_ACTIVE = 1e-7
# A saving below this share of the largest one has underflowed and determines no price.
_NO_SAVING = 1e-200

ContinuousLaw = PowerLaw | ExponentialLaw


@dataclass(frozen=True)
class Optimum:
    """The cheapest tolerances."""

    tolerance: Array  # shape (k,)
    price: Array  # multiplier of each response, shape (r,): cost saved per unit of additional room
    # bound on how much cheaper another set can be, in money; 0 if this one is proved to be the cheapest
    gap: float = 0.0


def cheapest(laws: Sequence[ContinuousLaw], rate: Array, room: Array, lower: Array, upper: Array) -> Optimum | None:
    """Return the cheapest tolerances; None if no tolerances within the bounds satisfy the constraints.

    In ``u = (t / upper)^2`` the cost is convex and the constraints are linear, so the optimum is unique. `rate`, shape
    (r, k), is the variance of each response per unit of squared tolerance, not negative; `room`, shape (r,), the
    permitted variance due to these variables. The bounds, shape (k,), are above 0 and equal for a locked variable.
    """
    from scipy.optimize import minimize  # takes 0.4 s, which `import reporting` avoids

    if np.any(rate @ lower**2 > room):
        return None
    # Scaled by what the bounds and the room allow each variable alone, all quantities are of order one.
    with np.errstate(divide="ignore", invalid="ignore"):
        alone = np.sqrt(np.min(np.where(rate > 0, room[:, None] / rate, np.inf), axis=0))
    most, scale = np.maximum(np.minimum(upper, alone), lower), np.where(room > 0, room, 1.0)
    low, load = (lower / most) ** 2, rate * most**2 / scale[:, None]
    start = np.maximum(low, 1 / low.size)
    fixed = sum(law.fixed for law in laws)
    unit = max(float(np.sum(_savings(laws, most * np.sqrt(start)) * most)), np.finfo(np.float64).tiny)

    def cost(u: Array) -> float:
        return (float(np.sum(costs(laws, most * np.sqrt(u)))) - fixed) / unit

    def slope(u: Array) -> Array:
        return np.asarray(-_savings(laws, most * np.sqrt(u)) * most / (2 * np.sqrt(u)) / unit)

    optimum = minimize(
        cost,
        start,
        jac=slope,
        method="SLSQP",
        bounds=np.column_stack([low, np.ones_like(low)]),
        constraints={"type": "ineq", "fun": lambda u: room / scale - load @ u, "jac": lambda _: -load},
        options={"ftol": 1e-16, "maxiter": 500},
    )
    tolerance = np.clip(most * np.sqrt(np.clip(optimum.x, low, 1.0)), lower, upper)
    return Optimum(tolerance, _prices(tolerance, _savings(laws, tolerance), rate, room, (lower, upper)))


def costs(laws: Sequence[ContinuousLaw], tolerance: Array) -> Array:
    """Return the cost of each variable's tolerance."""
    return np.array([float(law.at(t)) for law, t in zip(laws, tolerance, strict=True)])


def _savings(laws: Sequence[ContinuousLaw], tolerance: Array) -> Array:
    """Return the cost saved per unit of each variable's tolerance."""
    return np.array([float(law.saving(t)) for law, t in zip(laws, tolerance, strict=True)])


def _prices(tolerance: Array, saving: Array, rate: Array, room: Array, bounds: tuple[Array, Array]) -> Array:
    """Return the multipliers of the responses from the Karush-Kuhn-Tucker conditions at the optimum.

    The saving of a wider tolerance is balanced by the active constraints, each with a non-negative multiplier.
    """
    from scipy.optimize import nnls  # see `cheapest`

    lower, upper = bounds
    decisive = saving > _NO_SAVING * np.max(saving, initial=0.0)
    active = room - rate @ tolerance**2 <= _ACTIVE * room
    at_upper, at_lower = tolerance > upper * (1 - _ACTIVE), tolerance < lower * (1 + _ACTIVE)
    unit = np.sum(saving * tolerance) / np.where(room > 0, room, 1.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slopes = 2 * tolerance / saving * rate[active] * unit[active, None]
    sides = np.eye(tolerance.size)
    balance = np.hstack([slopes.T, sides[:, at_upper], -sides[:, at_lower]])[decisive]
    price = np.zeros(room.size)
    if np.any(decisive):
        # SciPy's own limit, 3 steps a column, is reached or not as the rounding of a processor has it
        multipliers, _ = nnls(balance, np.ones(balance.shape[0]), maxiter=30 * balance.shape[1])
        price[active] = multipliers[: np.count_nonzero(active)]
    return price * unit
