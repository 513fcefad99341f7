"""The problem of an allocation: variables with costs, responses with targets, and whether it has a solution."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reporting.capability.indices import distance_to_limit
from reporting.errors import ReportError
from reporting.tolerance.cost_laws import CostLaw, Process, ProcessTable

# The sum of shares of a variance may exceed 1 by this rounding error only.
_ROUNDING = 1e-9


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
