"""How far the spread of one variable may grow while every response keeps its target index.

The index at another spread follows from reweighting the campaign's samples as long as the weights are reliable; beyond
that from the variable's share S_i of the variance, ``sigma_y^2 (1 + S_i (f^2 - 1))``, with an unchanged mean.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting.arrays import Array, random_rows
from reporting.capability.indices import cpk
from reporting.errors import ReportError
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import what_if_all

REWEIGHTING, CONTRIBUTIONS = "reweighting", "variance contributions"
MOST_FACTOR, LEAST_FACTOR = 4.0, 0.05
_PRECISION = 5e-4  # of the factor
_ROWS = 50_000  # determine a Cpk of 1.33 to 0.3 %

Rows = NDArray[np.intp]
Widen = Callable[[str, float, Rows], Change]


@dataclass(frozen=True)
class Advice:
    """How far the spread of one variable may change while the others stay as they are.

    Attributes
    ----------
    variable : str
    factor : float or None
        Largest factor on the spread. Below 1 the spread must shrink for the responses to reach their targets; None: no
        spread of this variable makes them reach their targets.
    bounded : bool
        False if every response still keeps its target at this factor, the largest tried.
    binding : str or None
        The response that limits the factor, or that misses its target.
    cpk : float or None
        Cpk of that response, at the factor.
    method : str
        How the index at the factor was found: "reweighting" or "variance contributions".
    effective : float or None
        Effective sample size at the factor; None without reweighting.
    """

    variable: str
    factor: float | None
    bounded: bool
    binding: str | None
    cpk: float | None
    method: str
    effective: float | None


@dataclass(frozen=True)
class _Margin:
    """The response with the smallest margin of Cpk over its target, at a factor."""

    margin: float
    response: str
    cpk: float
    method: str
    effective: float | None


@dataclass(frozen=True)
class _Target:
    """A response with limits and a target: its values, and the shares of its variance."""

    y: Array
    lsl: float | None
    usl: float | None
    target: float
    shares: Mapping[str, float | None]

    def cpk(self, growth: float) -> float | None:
        """Return Cpk with the variance multiplied by `growth`; None without a variance."""
        y = self.y[np.isfinite(self.y)]
        std = float(np.std(y, ddof=1)) * math.sqrt(max(growth, 0.0))
        return cpk(float(np.mean(y)), std, self.lsl, self.usl) if std > 0 else None


def advise(
    responses: Mapping[str, ArrayLike],
    limits: Mapping[str, tuple[float | None, float | None]],
    targets: Mapping[str, float],
    contributions: Mapping[str, Mapping[str, float | None]],
    variables: Sequence[str],
    widen: Widen,
) -> tuple[Advice, ...]:
    """Return how far the spread of each variable may grow.

    Parameters
    ----------
    responses : mapping of str to array_like, each of shape (n,)
        Values at each sample, NaN where there is none.
    limits : mapping of str to (lsl, usl)
        Responses without limits are ignored.
    targets : mapping of str to float
        Required Cpk of each response with limits.
    contributions : mapping of str to mapping of str to float
        Share of the variance of each response by variable (first-order index); missing shares count as 0.
    variables : sequence of str
        Variables that the advice is for.
    widen : callable (variable, factor, rows) -> Change
        Change of the density at these rows when the standard deviation of the variable is multiplied by the factor.
        Where a distribution cannot follow exactly (a truncated one), `Change.spread` is the factor that it reaches.

    Raises
    ------
    ReportError
        No response has both limits and a target.
    """
    first = next(iter(responses.values()), np.zeros(0))
    rows = random_rows(np.size(first))[:_ROWS]
    limited = {
        name: _Target(np.asarray(y, np.float64)[rows], *limits[name], targets[name], contributions.get(name, {}))
        for name, y in responses.items()
        if name in targets and limits.get(name, (None, None)) != (None, None)
    }
    varying = {name: r for name, r in limited.items() if np.unique(r.y[np.isfinite(r.y)]).size > 1}
    if not varying:
        raise ReportError(
            "advice: no response has limits, a target Cpk and values that vary; give limits to at least one"
        )
    return tuple(_advice(variable, varying, lambda f, v=variable: widen(v, f, rows)) for variable in variables)  # type: ignore[misc]


def _advice(variable: str, targets: Mapping[str, _Target], widen: Callable[[float], Change]) -> Advice:
    """Return the largest factor at which no response misses its target."""
    from scipy.optimize import brentq

    def at(factor: float) -> _Margin:
        return _least_margin(variable, factor, targets, widen(factor))

    now = at(1.0)
    low, high = (1.0, MOST_FACTOR) if now.margin >= 0 else (LEAST_FACTOR, 1.0)
    at_low, at_high = (now, at(high)) if now.margin >= 0 else (at(low), now)
    if at_low.margin < 0:
        return Advice(variable, None, True, at_low.response, at_low.cpk, at_low.method, at_low.effective)
    if at_high.margin >= 0:
        return Advice(variable, high, False, at_high.response, at_high.cpk, at_high.method, at_high.effective)
    root = float(brentq(lambda f: at(f).margin, low, high, rtol=_PRECISION)) if at_low.margin > 0 else low
    factor = max(root * (1 - _PRECISION), low)  # on the safe side of the root
    binding = at(factor)
    return Advice(variable, factor, True, binding.response, binding.cpk, binding.method, binding.effective)


def _least_margin(variable: str, factor: float, targets: Mapping[str, _Target], change: Change) -> _Margin:
    """Return the response with the smallest margin of Cpk over its target."""
    spread = factor if change.spread is None else change.spread
    limits = {name: (response.lsl, response.usl) for name, response in targets.items()}
    answers = what_if_all({name: response.y for name, response in targets.items()}, change, limits)
    margins = []
    for name, response in targets.items():
        reweighted = answers[name].cpk
        modelled = response.cpk(1 + (response.shares.get(variable) or 0.0) * (spread**2 - 1))
        if reweighted is not None:
            index, method, effective = reweighted.value, REWEIGHTING, answers[name].effective
        elif modelled is not None:
            index, method, effective = modelled, CONTRIBUTIONS, None
        else:  # a response without variance keeps its target at any spread
            continue
        margins.append(_Margin(index - response.target, name, index, method, effective))
    return min(margins, key=lambda m: m.margin) if margins else _Margin(np.inf, "", np.inf, CONTRIBUTIONS, None)
