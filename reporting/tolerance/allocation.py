"""Allocation: the cheapest tolerances with which every response keeps its target Cpk.

The cost of a tolerance t_i of variable i is given by its law or table (`reporting.tolerance.cost_laws`). The variance
of a response is the sum of the contributions of the variables, ``sigma_y^2 = rest + sum c_i t_i^2``; it must not
exceed ``(distance from the mean to the nearer limit / (3 target))^2``. `reporting.tolerance.cost_optimum` finds the
optimum and the price of each target, `reporting.tolerance.cost_optimum` the cheapest processes.

If the campaign's samples can be reweighted to the proposed tolerances, the reweighted mean and sigma correct the
linear model, and the optimum is recomputed until it no longer changes. If they cannot, as where tolerances must grow,
an emulator of the rows takes the place of the linear model: at each set of tolerances it gives mean and variance of a
response and their slopes, and the optimum of this local model is the next set. A proposal aims at the target by the
samples' own sigma, so about half of the proposals miss it by a little: the interval of the resulting Cpk says by how
much.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from reporting.arrays import Array, random_rows
from reporting.capability.indices import distance_to_limit
from reporting.capability.intervals import Interval
from reporting.errors import ReportError
from reporting.tolerance.advice import EMULATION, REWEIGHTING, Rows
from reporting.tolerance.cost_laws import CostLaw, Process, ProcessTable
from reporting.tolerance.cost_optimum import Optimum, Programme, cheapest_choice
from reporting.tolerance.index_curve import Emulation, Moments
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import WhatIf, runs_for, what_if_all

# The sum of shares of a variance may exceed 1 by this rounding error only.
_ROUNDING = 1e-9
CONTRIBUTIONS = "variance contributions"
_NO_INTERVAL = (
    "Variance contributions give no interval of Cpk, and interactions or a bent response may make it far lower: "
    "confirm the proposal by a campaign before you use it."
)
_CORRECTIONS = 12
_UNDAMPED = 6  # corrections by an emulator; later ones go half the way, so that they cannot alternate
_NOT_CONVERGED = "The corrections did not converge: confirm the proposal by a campaign before you use it."
_SAME_FACTOR = 1e-3  # the corrections end when no tolerance changes by a larger share

Rescale = Callable[[Mapping[str, float], Rows], Change]


@dataclass(frozen=True)
class CostedVariable:
    """A variable, the cost of its tolerance, and the permitted changes."""

    variable: str
    tolerance: float  # the present one: any measure proportional to the standard deviation
    law: CostLaw
    lower: float  # bound of the tolerance, 0 < lower <= upper
    upper: float
    locked: bool = False  # the tolerance must stay as it is

    @property
    def processes(self) -> tuple[Process, ...]:
        """Processes to choose from; empty if the law is continuous or the tolerance is locked."""
        if self.locked or not isinstance(self.law, ProcessTable):
            return ()
        return self.law.between(self.lower, self.upper)

    @property
    def tightest(self) -> float:
        """Smallest tolerance that may be chosen."""
        if self.locked:
            return self.tolerance
        return self.processes[0].tolerance if self.processes else self.lower

    def cost_of(self, tolerance: float) -> float | None:
        """Return the cost of a tolerance; in a table, of the cheapest process at most as wide, None without one."""
        if isinstance(self.law, ProcessTable):
            process = self.law.at(tolerance)
            return None if process is None else process.cost
        return float(self.law.at(np.asarray(tolerance)))


@dataclass(frozen=True)
class Requirement:
    """A response as it is now, and the Cpk it must have."""

    response: str
    mean: float  # present value, in the unit of the response
    std: float  # like `mean`
    lsl: float | None  # at least one limit
    usl: float | None
    target: float  # required Cpk, above 0
    # Present share of the variance by variable (first-order index or contribution), 0 to 1, with a sum of at most 1;
    # the rest does not depend on the tolerances.
    shares: Mapping[str, float]
    added: float = 0.0  # correction of the variance by reweighting

    @property
    def allowed(self) -> float:
        """Variance at which Cpk equals the target; 0 if the mean is out of limits."""
        return (max(distance_to_limit(self.mean, self.lsl, self.usl), 0.0) / (3 * self.target)) ** 2

    def variance(self, factors: Mapping[str, float]) -> float:
        """Return the variance with the tolerances multiplied by `factors`."""
        grown = sum(share * (factors.get(name, 1.0) ** 2 - 1) for name, share in self.shares.items())
        return self.std**2 * (1 + grown) + self.added


@dataclass(frozen=True)
class AllocatedResponse:
    """A response with the proposed tolerances."""

    response: str
    mean: float
    std: float
    cpk: float
    target: float
    binding: bool  # the target of this response limits the tolerances
    # additional cost of a target Cpk higher by 0.01; None with process tables, whose cost has steps
    price: float | None
    # of `cpk`, at 95 %, from the reweighted or emulated samples; None where variance contributions give it
    cpk_interval: Interval | None = None
    ppm_interval: Interval | None = None  # of the share out of limits, like `cpk_interval`


@dataclass(frozen=True)
class Allocation:
    """Proposed tolerances."""

    tolerances: dict[str, float]  # proposed; empty if refused
    factors: dict[str, float]  # their ratio to the present ones
    cost: float | None  # of the proposed tolerances
    # Of the present tolerances. With a table, a present tolerance has the cost of the cheapest process that is at most
    # as wide; the cost is unknown if there is none.
    cost_now: float | None
    responses: tuple[AllocatedResponse, ...]
    # "reweighting" or "emulation" if mean and sigma of the responses come from it, else "variance contributions"
    method: str
    effective: float | None  # new samples that the reweighted or emulated ones are worth
    runs: int  # to confirm the proposal: they determine each Cpk to 5 %
    refusal: str = ""  # why there is no proposal; empty if there is one
    notes: tuple[str, ...] = ()
    processes: dict[str, str] = field(default_factory=dict)  # the chosen process of each variable with named processes
    # What to write into the campaign file for each variable that changes, in the digits of a drawing.
    written: dict[str, tuple[str, ...]] = field(default_factory=dict)
    covered: tuple[str, ...] = ()  # variables whose tolerance ends where the rows do: it might grow farther

    def __repr__(self) -> str:
        """Return what to change and what that costs in a line, or why nothing is proposed."""
        if self.refusal:
            return f"<Allocation refused: {self.refusal}>"
        changes = ", ".join(f"{name} x {self.factors[name]:.4g}" for name in self.tolerances)
        now = "unknown" if self.cost_now is None else f"{self.cost_now:.4g}"
        indices = ", ".join(f"{each.response} {each.cpk:.4g}" for each in self.responses)
        return f"<Allocation: {changes}; cost {self.cost:.4g}, now {now}; Cpk of {indices}>"


def allocate(
    variables: Sequence[CostedVariable],
    requirements: Sequence[Requirement],
    responses: Mapping[str, ArrayLike] | None = None,
    rescale: Rescale | None = None,
    correlated: bool = False,
    emulation: Emulation | None = None,
) -> Allocation:
    """Return the cheapest tolerances; those of variables without a cost stay as they are.

    The responses of the campaign's samples, shape (n,), and `rescale` (factors by variable, rows), which gives the
    change of the density at the rows, are for the correction by reweighting; `emulation` is asked where the weights are
    refused. If a variable whose tolerance may change is correlated with another, the variance of a response is not a
    sum of contributions, and a proposal is made only if one of them gives mean and sigma. ReportError: a cost,
    tolerance, bound or target is impossible, or a variable or response is given twice.
    """
    check(variables, requirements)
    optimum = _solve(variables, requirements)
    if optimum is None or responses is None or rescale is None:
        proposal = _proposal(variables, requirements, optimum, CONTRIBUTIONS, None)
    else:
        proposal = _with_reweighting(variables, requirements, optimum, responses, rescale, emulation)
    return _of_correlated(proposal) if correlated else proposal


def check(variables: Sequence[CostedVariable], requirements: Sequence[Requirement]) -> None:
    """Raise ReportError if the input is invalid for an allocation."""
    if not variables or not requirements:
        raise ReportError("allocation: at least one variable with a cost and one response with limits are needed")
    for kind, names in (
        ("variable", [v.variable for v in variables]),
        ("response", [r.response for r in requirements]),
    ):
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ReportError(f"allocation: {kind} {twice!r} is given twice; give it once")
    for v in variables:
        numbers = (v.tolerance, v.lower, v.upper)
        if not all(math.isfinite(number) and number > 0 for number in numbers) or v.lower > v.upper:
            raise ReportError(
                f"allocation: {v.variable}: tolerance {v.tolerance:g}, bounds {v.lower:g} to {v.upper:g}: all must be "
                "finite and above 0, the lower bound not above the upper"
            )
        fault = v.law.fault() or _no_process(v)
        if fault:
            raise ReportError(f"allocation: {v.variable}: {fault}")
    for r in requirements:
        _check_shares(r)
        if r.lsl is None and r.usl is None:
            raise ReportError(f"allocation: {r.response} has no limits, and so no Cpk to keep; leave it out")
        if not (math.isfinite(r.target) and r.target > 0 and math.isfinite(r.mean) and math.isfinite(r.std)):
            raise ReportError(
                f"allocation: {r.response}: mean {r.mean:g}, sigma {r.std:g}, target {r.target:g}: finite numbers and "
                "a target Cpk above 0 are needed"
            )


def infeasible(variables: Sequence[CostedVariable], requirements: Sequence[Requirement]) -> str:
    """Return which response cannot reach its target, its best Cpk, and remedies."""
    tightest = {v.variable: v.tightest / v.tolerance for v in variables}
    worst = min(requirements, key=lambda r: r.allowed - r.variance(tightest))
    if worst.allowed == 0:
        return (
            f"{worst.response}: its mean {worst.mean:.6g} is out of limits, which no tolerance changes; move the mean"
        )
    cpk = worst.target * math.sqrt(worst.allowed / worst.variance(tightest))
    return (
        f"{worst.response}: with every tolerance at its lower bound Cpk is {cpk:.3f}; the target is {worst.target:g};"
        " lower the bounds, unlock variables, move the mean to the middle of the limits, or widen the limits"
    )


def _no_process(v: CostedVariable) -> str:
    """Return that a table offers no process; empty if it does, or if the law is continuous."""
    if not isinstance(v.law, ProcessTable):
        return ""
    if v.locked:
        if v.law.at(v.tolerance) is not None:
            return ""
        return f"locked at {v.tolerance:g}, but no process of its table is as fine; add that process, or unlock it"
    if v.processes:
        return ""
    return f"no process lies within the bounds {v.lower:g} to {v.upper:g}; widen them, or add a process"


def _check_shares(r: Requirement) -> None:
    """Raise ReportError unless the shares can be parts of one variance."""
    for name, share in r.shares.items():
        if not share >= 0:
            raise ReportError(
                f"allocation: {r.response}: the share of {name} is {share:g}; a share of the variance is at least 0"
            )
    total = sum(r.shares.values())
    if total > 1 + _ROUNDING:
        raise ReportError(
            f"allocation: {r.response}: the shares of the variance add up to {total:g}; they may add up to 1 at most"
        )


def _with_reweighting(
    variables: Sequence[CostedVariable],
    requirements: Sequence[Requirement],
    optimum: Optimum,
    responses: Mapping[str, ArrayLike],
    rescale: Rescale,
    emulation: Emulation | None,
) -> Allocation:
    """Correct the model at the optimum and optimise again until nothing changes or the weights are refused."""
    linear, effective, found = requirements, None, dict[str, WhatIf]()
    columns = {r.response: np.asarray(responses[r.response], np.float64) for r in requirements}
    rows = random_rows(next(iter(columns.values())).size)
    columns = {name: y[rows] for name, y in columns.items()}
    for _ in range(_CORRECTIONS):
        factors = _factors(variables, optimum.tolerance)
        corrected = _corrected(requirements, factors, columns, rescale(factors, rows))
        if isinstance(corrected, str):
            note = f"Linear estimate only: too few samples near the proposed tolerances to check it ({corrected})."
            if emulation is not None:
                try:
                    return _with_emulation(variables, linear, emulation, corrected)
                except ReportError as error:
                    note += f" No emulator either: {error}."
            return _proposal(variables, requirements, optimum, CONTRIBUTIONS, None, (note,))
        requirements, effective, found = corrected
        following = _solve(variables, requirements)
        if following is None:
            return _proposal(variables, requirements, None, REWEIGHTING, effective)
        unchanged = bool(np.max(np.abs(following.tolerance / optimum.tolerance - 1)) < _SAME_FACTOR)
        optimum = following
        if unchanged:
            return _with_intervals(_proposal(variables, requirements, optimum, REWEIGHTING, effective), found)
    proposal = _proposal(variables, requirements, optimum, REWEIGHTING, effective, (_NOT_CONVERGED,))
    return _with_intervals(proposal, found)


def _with_emulation(
    variables: Sequence[CostedVariable], requirements: Sequence[Requirement], emulation: Emulation, why: str
) -> Allocation:
    """Optimise local models of the emulated responses until nothing changes; ReportError: they are not to be used."""
    reachable = [_within_reach(v, emulation) for v in variables]
    tightest = np.array([v.tightest for v in reachable])
    separate = np.array([bool(v.processes) for v in reachable])
    start = _solve(reachable, requirements)
    tolerance = tightest if start is None else start.tolerance
    free, is_same = [v.variable for v in reachable if not v.locked], False
    for step in range(2 * _CORRECTIONS):
        factors = _factors(variables, tolerance)
        moments = emulation.moments(factors, free)
        requirements = [_local(r, moments[r.response], factors) for r in requirements]
        optimum = _solve(reachable, requirements)
        if optimum is None and np.all(tolerance <= tightest):
            return _proposal(reachable, requirements, None, EMULATION, None)
        following = tightest if optimum is None else optimum.tolerance
        is_same = optimum is not None and bool(np.max(np.abs(following / tolerance - 1)) < _SAME_FACTOR)
        if is_same:
            break
        halfway = separate | (optimum is None) | (step < _UNDAMPED)
        tolerance = np.where(halfway, following, np.sqrt(tolerance * following))
    answers = emulation.answers(_factors(variables, tolerance), why)
    ends = [
        v.variable
        for v, asked, t in zip(reachable, variables, tolerance, strict=True)
        if v.upper < asked.upper and t > v.upper * (1 - _SAME_FACTOR)
    ]
    notes = [] if is_same else [_NOT_CONVERGED]
    notes += list(dict.fromkeys(f"{name}: {each.notes[-1]}" for name, each in answers.items()))
    if ends:
        notes.append(
            f"{', '.join(ends)}: the rows reach no farther; from runs with these sigmas a wider tolerance may follow."
        )
    effective = min(each.effective for each in answers.values())
    proposal = _proposal(reachable, requirements, optimum, EMULATION, effective, tuple(notes))
    return replace(_with_intervals(proposal, answers), covered=tuple(ends))


def _within_reach(v: CostedVariable, emulation: Emulation) -> CostedVariable:
    """Return a variable whose tolerance does not grow beyond what the rows cover."""
    if v.locked or v.upper <= v.tolerance:
        return v
    upper = max(emulation.reach(v.variable, v.upper / v.tolerance) * v.tolerance, v.lower)
    reachable = replace(v, upper=min(upper, v.upper))
    return reachable if reachable.processes or not v.processes else v


def _local(r: Requirement, moments: Moments, factors: Mapping[str, float]) -> Requirement:
    """Return a requirement whose variance and room are right, to first order, near these factors."""
    now = replace(r, mean=moments.mean)
    distance = distance_to_limit(moments.mean, r.lsl, r.usl)
    toward = 1.0 if r.usl is None or (r.lsl is not None and moments.mean - r.lsl < r.usl - moments.mean) else -1.0
    room = 2 * max(distance, 0.0) * toward / (3 * r.target) ** 2  # change of the permitted variance with the mean
    slopes = {
        name: max(slope - room * moments.mean_slope[name], 0.0) / r.std**2
        for name, slope in moments.variance_slope.items()
    }
    now = replace(now, shares=slopes, added=0.0)
    return replace(now, added=moments.variance - now.variance(factors))


def _of_correlated(proposal: Allocation) -> Allocation:
    """Return the proposal if the joint distribution of correlated variables confirmed it, else a refusal."""
    if proposal.method == EMULATION and not proposal.refusal and _NOT_CONVERGED not in proposal.notes:
        return proposal
    if proposal.method == REWEIGHTING and not proposal.refusal and _NOT_CONVERGED not in proposal.notes:
        note = "The variables are correlated: the targets hold with the correlations, but a cheaper set may exist."
        return replace(proposal, notes=(*proposal.notes, note))
    refusal = (
        "the variables are correlated, so a response's variance is not the sum of their shares, and the samples"
        " carry no answer at cheaper tolerances; bring the bounds nearer to the present ones, or lock correlated"
        " variables"
    )
    return replace(proposal, tolerances={}, factors={}, cost=None, responses=(), processes={}, refusal=refusal)


def _solve(variables: Sequence[CostedVariable], requirements: Sequence[Requirement]) -> Optimum | None:
    """Return the optimum of the linear model; None if no tolerances within their bounds keep every target."""
    # A locked variable is treated as a single process, whatever its law.
    now = np.array([v.tolerance for v in variables])
    rate = np.array([[r.std**2 * r.shares.get(v.variable, 0.0) for v in variables] for r in requirements]) / now**2
    room = np.array([r.allowed - r.variance(dict.fromkeys((v.variable for v in variables), 0.0)) for r in requirements])
    free = {i: v.law for i, v in enumerate(variables) if not v.locked and not isinstance(v.law, ProcessTable)}
    tables = {i: v.processes or (Process(v.tolerance, 0.0),) for i, v in enumerate(variables) if i not in free}
    lower, upper = (np.array([getattr(variables[i], end) for i in free]) for end in ("lower", "upper"))
    rates = rate[:, list(free)], rate[:, list(tables)]
    if np.any(room < 0):
        return None
    found = cheapest_choice(
        Programme(tuple(free.values()), lower, upper, rates[0], tuple(tables.values()), rates[1], room)
    )
    if found is None:
        return None
    optimum, chosen = found
    tolerance = now.copy()
    tolerance[list(free)] = optimum.tolerance
    tolerance[list(tables)] = [process.tolerance for process in chosen]
    return replace(optimum, tolerance=tolerance)


def _corrected(
    requirements: Sequence[Requirement], factors: Mapping[str, float], columns: Mapping[str, Array], change: Change
) -> tuple[list[Requirement], float, dict[str, WhatIf]] | str:
    """Return requirements with reweighted mean and variance, the effective sample size, the answers; or a refusal."""
    limits = {r.response: (r.lsl, r.usl) for r in requirements}
    answers = what_if_all(columns, change, limits)
    corrected = []
    for requirement in requirements:
        answer = answers[requirement.response]
        if answer.refusal or answer.mean is None or answer.std is None:
            return answer.refusal or f"{requirement.response} has no spread at these tolerances"
        missing = answer.std.value**2 - requirement.variance(factors)
        corrected.append(replace(requirement, mean=answer.mean.value, added=requirement.added + missing))
    return corrected, min(answer.effective for answer in answers.values()), answers


def _with_intervals(proposal: Allocation, found: Mapping[str, WhatIf]) -> Allocation:
    """Return a proposal with the intervals that were `found` at nearly the same tolerances."""
    responses, notes = [], []
    for r in proposal.responses:
        answer = found[r.response]
        estimate = answer.cpk
        if estimate is None or estimate.value <= 0 or not math.isfinite(r.cpk):
            responses.append(r)
            continue
        low, high = (end * r.cpk / estimate.value for end in estimate.interval)
        ppm = None if answer.ppm is None else answer.ppm.interval
        responses.append(replace(r, cpk_interval=(low, high), ppm_interval=ppm))
        if low < r.target and r.binding:
            remedy = (
                f"; with a target of {r.target * r.cpk / low:.3g} it would begin at {r.target:g}" if low > 0 else ""
            )
            notes.append(f"{r.response}: the 95 % interval of Cpk begins at {low:.3g}, below the target{remedy}.")
    return replace(proposal, responses=tuple(responses), notes=(*proposal.notes, *notes))


def _proposal(
    variables: Sequence[CostedVariable],
    requirements: Sequence[Requirement],
    optimum: Optimum | None,
    method: str,
    effective: float | None,
    notes: tuple[str, ...] = (),
) -> Allocation:
    """Return the allocation of an optimum, or its refusal without one."""
    cost_now = _total_cost(variables, [v.tolerance for v in variables])
    runs = max(runs_for(r.target) for r in requirements)
    if optimum is None:
        refusal = infeasible(variables, requirements)
        return Allocation({}, {}, None, cost_now, (), method, effective, runs, refusal, notes)
    factors = _factors(variables, optimum.tolerance)
    prices = optimum.price if not any(v.processes for v in variables) else [None] * len(requirements)
    responses = tuple(
        _allocated(requirement, requirement.variance(factors), price)
        for requirement, price in zip(requirements, prices, strict=True)
    )
    tolerances = {v.variable: float(t) for v, t in zip(variables, optimum.tolerance, strict=True)}
    chosen = [(v.variable, p) for v in variables for p in v.processes if p.tolerance == tolerances[v.variable]]
    if method == CONTRIBUTIONS:
        notes = (*notes, _NO_INTERVAL)
    if optimum.gap > 0:
        notes = (*notes, f"Not every choice of processes was tried: a cheaper one may save up to {optimum.gap:.3g}.")
    return Allocation(
        tolerances=tolerances,
        factors=factors,
        cost=_total_cost(variables, tolerances.values()),
        cost_now=cost_now,
        responses=responses,
        method=method,
        effective=effective,
        runs=runs,
        notes=notes,
        processes={name: process.name for name, process in chosen if process.name},
    )


def _total_cost(variables: Sequence[CostedVariable], tolerances: Iterable[float]) -> float | None:
    """Return the total cost of one tolerance per variable; None if a cost is unknown."""
    known = [v.cost_of(t) for v, t in zip(variables, tolerances, strict=True)]
    return None if None in known else sum(cost for cost in known if cost is not None)


def _allocated(requirement: Requirement, variance: float, price: float | None) -> AllocatedResponse:
    """Return a response with its variance for the proposed tolerances; `price` is the price of a unit of variance."""
    allowed, target = requirement.allowed, requirement.target
    return AllocatedResponse(
        response=requirement.response,
        mean=requirement.mean,
        std=math.sqrt(max(variance, 0.0)),
        cpk=target * math.sqrt(allowed / variance) if variance > 0 else math.inf,
        target=target,
        binding=allowed - variance < 1e-6 * allowed,
        # The permitted variance is proportional to target^-2: a target higher by 0.01 takes 0.02 / target of it.
        price=None if price is None else float(0.01 * price * 2 * allowed / target),
    )


def _factors(variables: Sequence[CostedVariable], tolerance: Array) -> dict[str, float]:
    """Return the ratio of the tolerances to the present ones."""
    return {v.variable: float(t / v.tolerance) for v, t in zip(variables, tolerance, strict=True)}
