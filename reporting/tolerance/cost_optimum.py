"""The cheapest tolerances: the convex programme behind an allocation, and the choice of processes.

Continuous tolerances minimise the cost with ``C t^2 <= room`` and bounds. Processes are chosen in combination with them
by exact branch and bound.
With a price on each unit of variance the problem separates into one small problem per variable, and the sum of their
optima is a lower bound of the cost (Lagrange). The prices that maximise it come from the linear programme in which
processes may be mixed and continuous tolerances take some forty values; any price gives a valid bound, so these
approximations do not affect the result. A branch is a choice of processes for some variables. It is abandoned if its
bound reaches the cost of the best set so far, or if even the finest processes of the other variables do not fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array
from reporting.tolerance.cost_laws import ExponentialLaw, PowerLaw, Process

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
    """Return the cheapest tolerances; None if no tolerances within the bounds satisfy the constraints."""
    # In ``u = (t / upper)^2`` the cost is convex and the constraints are linear, so the optimum is unique. `rate`,
    # shape (r, k), is the variance of each response per unit of squared tolerance, not negative; `room`, shape (r,),
    # the permitted variance due to these variables. The bounds, shape (k,), are above 0 and equal for a locked
    # variable.
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
    """Return the multipliers of the responses from the Karush-Kuhn-Tucker conditions at the optimum."""
    # The saving of a wider tolerance is balanced by the active constraints, each with a non-negative multiplier.
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


_GRID = 41  # tolerances of a continuous variable in the linear programme
# About ten seconds; then the best set so far is returned with its gap. Cost of a continuous optimum in branches.
_MOST_BRANCHES, _OF_A_CONTINUOUS_OPTIMUM = 200_000, 400
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Programme:
    """Continuous variables and variables with processes."""

    laws: tuple[ContinuousLaw, ...]  # of the continuous variables
    lower: Array  # bounds of their tolerances, shape (k,)
    upper: Array
    rate: Array  # variance of each response per unit of their squared tolerance, not negative, shape (r, k)
    # processes of each other variable, the finest first; each wider process is cheaper
    tables: tuple[tuple[Process, ...], ...]
    table_rate: Array  # like `rate`, for the variables with tables, shape (r, d)
    room: Array  # permitted variance of each response due to all these variables, shape (r,)


def cheapest_choice(programme: Programme) -> tuple[Optimum, tuple[Process, ...]] | None:
    """Return the optimum of the continuous tolerances and the chosen processes; None if no choice fits."""
    search = _Search(programme)
    search.branch((), programme.room, 0.0)
    if search.best is None:
        return None
    optimum, order = search.best
    chosen = dict(zip(search.order, order, strict=True))
    gap = max(search.cost - search.open_bound, 0.0)
    processes = tuple(table[chosen[i]] for i, table in enumerate(programme.tables))
    return Optimum(optimum.tolerance, optimum.price, gap), processes


class _Search:
    """The state of a search: the prices, their bound, and the best set so far."""

    def __init__(self, programme: Programme) -> None:
        """Find the prices, and the cost of each process above the bound."""
        self.programme = programme
        self.loads = [
            np.outer([p.tolerance**2 for p in table], programme.table_rate[:, i])
            for i, table in enumerate(programme.tables)
        ]
        chosen = any(len(table) > 1 for table in programme.tables)
        price = _linear_prices(programme, self.loads) if chosen else np.zeros(programme.room.size)
        priced = [
            np.array([p.cost for p in table]) + load @ price
            for table, load in zip(programme.tables, self.loads, strict=True)
        ]
        self.bound = sum(float(each.min()) for each in priced) - float(price @ programme.room)
        self.bound += _least(programme, price)
        self.above = [each - each.min() for each in priced]
        # The variable whose processes differ most is decided first.
        self.order = sorted(range(len(priced)), key=lambda i: -float(np.ptp(self.above[i])))
        finest = [self.loads[i][0] for i in self.order]
        self.rest = [sum(finest[at:], programme.rate @ programme.lower**2) for at in range(len(finest) + 1)]
        self.cost, self.best = np.inf, None  # type: float, tuple[Optimum, tuple[int, ...]] | None
        self.branches, self.open_bound = 0, np.inf

    def branch(self, chosen: tuple[int, ...], room: Array, above: float) -> None:
        """Search all sets that begin with these processes, the most promising first."""
        if np.any(self.rest[len(chosen)] > room * (1 + _ROUNDING)):
            return
        if self.bound + above >= self.cost - _ROUNDING * abs(self.cost):
            return
        self.branches += 1
        if self.branches > _MOST_BRANCHES and self.best is not None:
            self.open_bound = min(self.open_bound, self.bound + above)
            return
        if len(chosen) == len(self.order):
            self._finish(chosen, room)
            return
        variable = self.order[len(chosen)]
        for process in np.argsort(self.above[variable], kind="stable").tolist():
            left = room - self.loads[variable][process]
            self.branch((*chosen, process), left, above + float(self.above[variable][process]))

    def _finish(self, chosen: tuple[int, ...], room: Array) -> None:
        """Find the continuous tolerances of a complete choice, and keep it if it is the cheapest."""
        p = self.programme
        cost = sum(p.tables[i][j].cost for i, j in zip(self.order, chosen, strict=True))
        optimum: Optimum | None = Optimum(np.zeros(0), np.zeros(room.size))
        if p.laws:
            self.branches += _OF_A_CONTINUOUS_OPTIMUM
            optimum = cheapest(p.laws, p.rate, np.maximum(room, 0.0), p.lower, p.upper)
            cost += 0.0 if optimum is None else float(np.sum(costs(p.laws, optimum.tolerance)))
        if optimum is not None and cost < self.cost:
            self.cost, self.best = cost, (optimum, chosen)


def _linear_prices(p: Programme, loads: Sequence[Array]) -> Array:
    """Return the prices of the linear programme; zeros where no mixture fits."""
    from scipy.optimize import linprog  # takes 0.4 s, which `import reporting` avoids

    blocks = [
        (np.array([process.cost for process in table]), load) for table, load in zip(p.tables, loads, strict=True)
    ]
    for law, low, high, rate in zip(p.laws, p.lower, p.upper, p.rate.T, strict=True):
        tolerance = np.geomspace(low, high, _GRID)
        blocks.append((law.at(tolerance), np.outer(tolerance**2, rate)))
    sizes = [cost.size for cost, _ in blocks]
    one_each = np.repeat(np.eye(len(sizes)), sizes, axis=1)
    scale = np.where(p.room > 0, p.room, 1.0)
    found = linprog(
        np.concatenate([cost for cost, _ in blocks]),
        A_ub=np.concatenate([load for _, load in blocks]).T / scale[:, None],
        b_ub=p.room / scale,
        A_eq=one_each,
        b_eq=np.ones(len(sizes)),
    )
    return -found.ineqlin.marginals / scale if found.status == 0 else np.zeros(p.room.size)


def _least(p: Programme, price: Array) -> float:
    """Return a lower bound of the cost of the continuous tolerances, with prices on their variance."""
    # Cost and priced variance are convex in the squared tolerance u, so between grid points the tangents bound them.
    total = 0.0
    for law, low, high, rate in zip(p.laws, p.lower, p.upper, p.rate.T, strict=True):
        u = np.geomspace(low**2, high**2, 64 * _GRID)
        t = np.sqrt(u)
        value, slope = law.at(t) + float(price @ rate) * u, float(price @ rate) - law.saving(t) / (2 * t)
        step = np.diff(u)
        tangents = np.maximum(
            value[:-1] + np.minimum(slope[:-1] * step, 0.0), value[1:] - np.maximum(slope[1:] * step, 0.0)
        )
        total += float(np.min(tangents, initial=float(value[0])))
    return total
