"""Cheapest tolerances with which every response keeps its target Cpk.

Making joint i to a tolerance t_i costs ``a_i + b_i / t_i``. The variance of a response is what its joints contribute,
``sigma_y^2 = rest + sum c_i t_i^2``, and must not exceed ``(distance to the nearer limit / (3 target))^2``. In
``s_i = t_i^2`` the cost is convex and everything else linear, so the optimum is the only one; a logarithmic barrier
finds it (Boyd, Vandenberghe 2004, section 11.3) and yields what each target costs.

Where the campaign's samples can be reweighted to the proposed tolerances, mean and sigma found that way correct the
linear model, and the optimum is sought again until it stays.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from reporting.arrays import Array, random_rows
from reporting.errors import ReportError
from reporting.tolerance.advice import CONTRIBUTIONS, REWEIGHTING, Rows
from reporting.tolerance.cost_optimum import Optimum, cheapest
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import runs_for, what_if_all

_CORRECTIONS = 12
_SETTLED = 1e-3  # change of a factor from one correction to the next

Rescale = Callable[[Mapping[str, float], Rows], Change]


@dataclass(frozen=True)
class CostedVariable:
    """What may be done to one variable's tolerance.

    Attributes
    ----------
    variable : str
    tolerance : float
        The present one; any measure that is proportional to the standard deviation.
    fixed, cost : float
        a and b of the cost ``a + b / tolerance``; b > 0 in money times the tolerance's unit.
    lower, upper : float
        Bounds of the tolerance, 0 < lower <= upper.
    locked : bool
        Stays as it is.
    """

    variable: str
    tolerance: float
    fixed: float
    cost: float
    lower: float
    upper: float
    locked: bool = False


@dataclass(frozen=True)
class Requirement:
    """A response as it is now, and the index it must have.

    Attributes
    ----------
    response : str
    mean, std : float
        Now, in its unit.
    lsl, usl : float or None
        Limits, at least one.
    target : float
        Wanted Cpk, > 0.
    shares : mapping of str to float
        Share of the variance by variable, now (first-order index or contribution); the rest stays whatever
        the tolerances.
    added : float
        Variance that the shares do not show: the correction by reweighting.
    """

    response: str
    mean: float
    std: float
    lsl: float | None
    usl: float | None
    target: float
    shares: Mapping[str, float]
    added: float = 0.0

    @property
    def allowed(self) -> float:
        """Variance at which Cpk is on target; 0 where the mean is out of limits."""
        sides = [s for s in (_minus(self.mean, self.lsl), _minus(self.usl, self.mean)) if s is not None]
        return (max(min(sides), 0.0) / (3 * self.target)) ** 2

    def variance(self, factors: Mapping[str, float]) -> float:
        """Return the variance with tolerances so many times what they are."""
        grown = sum(share * (factors.get(name, 1.0) ** 2 - 1) for name, share in self.shares.items())
        return self.std**2 * (1 + grown) + self.added


@dataclass(frozen=True)
class AllocatedResponse:
    """A response under the proposed tolerances.

    Attributes
    ----------
    response : str
    mean, std, cpk, target : float
    binding : bool
        Its target limits the tolerances.
    price : float
        What 0.01 more of target Cpk would cost.
    """

    response: str
    mean: float
    std: float
    cpk: float
    target: float
    binding: bool
    price: float


@dataclass(frozen=True)
class Allocation:
    """A proposal.

    Attributes
    ----------
    tolerances, factors : dict of str to float
        Proposed tolerances, and how many times the present ones that is; empty when refused.
    cost, cost_now : float or None
        Of the proposed and of the present tolerances.
    responses : tuple of AllocatedResponse
    method : str
        "reweighting" where mean and sigma of the responses were found so, else "variance contributions".
    effective : float or None
        Effective sample size of the reweighting.
    runs : int
        Runs of the campaign that confirms the proposal: they know each Cpk to 5 %.
    refusal : str
        Why there is no proposal; empty where there is.
    notes : tuple of str
    """

    tolerances: dict[str, float]
    factors: dict[str, float]
    cost: float | None
    cost_now: float
    responses: tuple[AllocatedResponse, ...]
    method: str
    effective: float | None
    runs: int
    refusal: str = ""
    notes: tuple[str, ...] = ()


def allocate(
    joints: Sequence[CostedVariable],
    requirements: Sequence[Requirement],
    responses: Mapping[str, ArrayLike] | None = None,
    rescale: Rescale | None = None,
) -> Allocation:
    """Return the cheapest tolerances.

    Parameters
    ----------
    joints : sequence of CostedVariable
        The variables whose tolerance is to be set; others stay as they are.
    requirements : sequence of Requirement
        The responses to keep.
    responses : mapping of str to array_like, each of shape (n,), optional
        Values at each sample of the campaign, to correct by reweighting.
    rescale : callable (factors by variable, rows) -> Change, optional
        The log ratio at these rows when each standard deviation is so many times what it is.

    Raises
    ------
    ReportError
        Costs, tolerances, bounds or targets that are impossible, a joint or response given twice.
    """
    _check(joints, requirements)
    found = _solve(joints, requirements)
    if found is None or responses is None or rescale is None:
        return _proposal(joints, requirements, found, CONTRIBUTIONS, None)
    return _with_reweighting(joints, requirements, found, responses, rescale)


def _with_reweighting(
    joints: Sequence[CostedVariable],
    wanted: Sequence[Requirement],
    found: Optimum,
    responses: Mapping[str, ArrayLike],
    rescale: Rescale,
) -> Allocation:
    """Correct the model at the optimum and seek it again, until it stays or the weights are no good."""
    effective = None
    columns = {r.response: np.asarray(responses[r.response], np.float64) for r in wanted}
    rows = random_rows(next(iter(columns.values())).size)
    columns = {name: y[rows] for name, y in columns.items()}
    for _ in range(_CORRECTIONS):
        factors = _factors(joints, found.tolerance)
        corrected = _corrected(wanted, factors, columns, rescale(factors, rows))
        if isinstance(corrected, str):
            note = f"Not corrected by reweighting at the proposed tolerances: {corrected}."
            return _proposal(joints, wanted, found, CONTRIBUTIONS, None, (note,))
        wanted, effective = corrected
        following = _solve(joints, wanted)
        if following is None:
            return _proposal(joints, wanted, None, REWEIGHTING, effective)
        stays = bool(np.max(np.abs(following.tolerance / found.tolerance - 1)) < _SETTLED)
        found = following
        if stays:
            return _proposal(joints, wanted, found, REWEIGHTING, effective)
    note = "The correction by reweighting did not settle: confirm by a run before anything else."
    return _proposal(joints, wanted, found, REWEIGHTING, effective, (note,))


def _solve(joints: Sequence[CostedVariable], wanted: Sequence[Requirement]) -> Optimum | None:
    """Return the optimum of the linear model, None if no tolerances within their bounds keep every target."""
    now = np.array([j.tolerance for j in joints])
    lower = np.array([j.tolerance if j.locked else j.lower for j in joints])
    upper = np.array([j.tolerance if j.locked else j.upper for j in joints])
    rate = np.array([[r.std**2 * r.shares.get(j.variable, 0.0) for j in joints] for r in wanted]) / now**2
    room = np.array([r.allowed - r.variance(dict.fromkeys((j.variable for j in joints), 0.0)) for r in wanted])
    return cheapest(np.array([j.cost for j in joints]), rate, room, lower, upper)


def _corrected(
    wanted: Sequence[Requirement], factors: Mapping[str, float], columns: Mapping[str, Array], change: Change
) -> tuple[list[Requirement], float] | str:
    """Return the requirements with means and variances found by reweighting, and its samples' worth; or why not."""
    limits = {r.response: (r.lsl, r.usl) for r in wanted}
    answers = what_if_all(columns, change, limits)
    corrected = []
    for requirement in wanted:
        answer = answers[requirement.response]
        if answer.refusal or answer.mean is None or answer.std is None:
            return answer.refusal or f"{requirement.response} has no spread there"
        missing = answer.std.value**2 - requirement.variance(factors)
        corrected.append(replace(requirement, mean=answer.mean.value, added=requirement.added + missing))
    return corrected, min(answer.effective for answer in answers.values())


def _proposal(
    joints: Sequence[CostedVariable],
    wanted: Sequence[Requirement],
    found: Optimum | None,
    method: str,
    effective: float | None,
    notes: tuple[str, ...] = (),
) -> Allocation:
    """Put the optimum into words and numbers."""
    cost_now = sum(j.fixed + j.cost / j.tolerance for j in joints)
    runs = max(runs_for(r.target) for r in wanted)
    if found is None:
        return Allocation({}, {}, None, cost_now, (), method, effective, runs, _infeasible(joints, wanted), notes)
    factors = _factors(joints, found.tolerance)
    responses = []
    for requirement, price in zip(wanted, found.price, strict=True):
        variance = requirement.variance(factors)
        std = math.sqrt(max(variance, 0.0))
        cpk = float(requirement.target * math.sqrt(requirement.allowed / variance)) if variance > 0 else math.inf
        a_hundredth = float(0.01 * price * 2 * requirement.allowed / requirement.target)
        responses.append(
            AllocatedResponse(
                requirement.response,
                requirement.mean,
                std,
                cpk,
                requirement.target,
                bool(requirement.allowed - variance < 1e-6 * requirement.allowed),
                a_hundredth,
            )
        )
    tolerances = {j.variable: float(t) for j, t in zip(joints, found.tolerance, strict=True)}
    cost = sum(j.fixed + j.cost / tolerances[j.variable] for j in joints)
    return Allocation(tolerances, factors, cost, cost_now, tuple(responses), method, effective, runs, "", notes)


def _infeasible(joints: Sequence[CostedVariable], wanted: Sequence[Requirement]) -> str:
    """Return which response cannot be kept, by how much, and what would help."""
    tightest = {j.variable: 1.0 if j.locked else j.lower / j.tolerance for j in joints}
    worst = min(wanted, key=lambda r: r.allowed - r.variance(tightest))
    if worst.allowed == 0:
        return f"{worst.response}: its mean {worst.mean:.6g} is out of limits; move the mean, no tolerance can help"
    cpk = worst.target * math.sqrt(worst.allowed / worst.variance(tightest))
    return (
        f"{worst.response}: with every tolerance at its lower bound Cpk is {cpk:.3f}, {worst.target:g} is wanted; "
        "lower the bounds, unlock joints, move its mean to the middle of its limits, or widen the limits"
    )


def _factors(joints: Sequence[CostedVariable], tolerance: Array) -> dict[str, float]:
    """Return how many times the present tolerance each one is."""
    return {j.variable: float(t / j.tolerance) for j, t in zip(joints, tolerance, strict=True)}


def _check(joints: Sequence[CostedVariable], requirements: Sequence[Requirement]) -> None:
    """Raise ReportError for what no allocation can be made of."""
    if not joints or not requirements:
        raise ReportError("allocation: at least one joint with a cost and one response with limits are needed")
    for kind, names in (("joint", [j.variable for j in joints]), ("response", [r.response for r in requirements])):
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ReportError(f"allocation: {kind} {twice!r} is given twice; give it once")
    for j in joints:
        numbers = (j.tolerance, j.cost, j.lower, j.upper)
        if not all(math.isfinite(v) and v > 0 for v in numbers) or not math.isfinite(j.fixed) or j.lower > j.upper:
            raise ReportError(
                f"allocation: {j.variable}: tolerance {j.tolerance:g}, cost {j.cost:g}, bounds {j.lower:g} to "
                f"{j.upper:g}: all must be finite and above 0, the lower bound not above the upper"
            )
    for r in requirements:
        if r.lsl is None and r.usl is None:
            raise ReportError(f"allocation: {r.response} has no limits, so no index to keep; leave it out")
        if not (math.isfinite(r.target) and r.target > 0 and math.isfinite(r.mean) and math.isfinite(r.std)):
            raise ReportError(
                f"allocation: {r.response}: mean {r.mean:g}, sigma {r.std:g}, target {r.target:g}: finite numbers and "
                "a target Cpk above 0 are needed"
            )


def _minus(high: float | None, low: float | None) -> float | None:
    """Return a difference, None if an end is missing."""
    return None if high is None or low is None else high - low
