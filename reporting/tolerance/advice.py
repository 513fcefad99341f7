"""How far the spread of each variable may grow, alone, with every response still at its target index.

The index at another spread is found by reweighting the campaign's samples as long as the weights are good, and beyond
that from the variable's share of the variance: ``sigma_y^2 (1 + S_i (f^2 - 1))`` with the mean as it is.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting.arrays import Array, random_rows
from reporting.errors import ReportError
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import what_if_all

REWEIGHTING, CONTRIBUTIONS = "reweighting", "variance contributions"
MOST_FACTOR, LEAST_FACTOR = 4.0, 0.05
_PRECISION = 5e-4  # of the factor
_ROWS = 50_000  # know a Cpk of 1.33 to 0.3 %

Rows = NDArray[np.intp]
Widen = Callable[[str, float, Rows], Change]


@dataclass(frozen=True)
class Advice:
    """How far the spread of one variable may go, the others as they are.

    Attributes
    ----------
    variable : str
    factor : float or None
        The spread may be so many times what it is. Below 1: it must shrink for the responses to reach their
        targets. None: they do not reach them whatever this variable does.
    bounded : bool
        False: at this factor, the largest tried, every response still keeps its target.
    binding : str or None
        The response that ends it, or that is not reached.
    cpk : float or None
        Of that response, at the factor.
    method : str
        "reweighting" or "variance contributions": what the index at the factor rests on.
    effective : float or None
        Effective sample size at the factor; None where that is not by reweighting.
    """

    variable: str
    factor: float | None
    bounded: bool
    binding: str | None
    cpk: float | None
    method: str
    effective: float | None


@dataclass(frozen=True)
class _At:
    """The response of least margin at a factor."""

    margin: float
    response: str
    cpk: float
    method: str
    effective: float | None


@dataclass(frozen=True)
class _Asked:
    """A response with limits and a target: its values, and its index now."""

    y: Array
    lsl: float | None
    usl: float | None
    target: float
    shares: Mapping[str, float | None]

    def cpk(self, growth: float) -> float | None:
        """Return Cpk with the variance grown so many times."""
        y = self.y[np.isfinite(self.y)]
        mean, std = float(np.mean(y)), float(np.std(y, ddof=1)) * np.sqrt(max(growth, 0.0))
        sides = [s for s in (_minus(mean, self.lsl), _minus(self.usl, mean)) if s is not None]
        return float(min(sides) / (3 * std)) if sides and std > 0 else None


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
        Responses without limits set no bound.
    targets : mapping of str to float
        Wanted Cpk of each response that has limits.
    contributions : mapping of str to mapping of str to float
        Share of the variance of each response by variable (first-order index); None or absent counts as 0.
    variables : sequence of str
        The variables to advise on.
    widen : callable (variable, factor, rows) -> Change
        The log ratio at these rows when the standard deviation of that variable is so many times what it is.
        Where the law cannot follow exactly (a truncated one), `Change.spread` says how many times it really is.

    Raises
    ------
    ReportError
        No response has both limits and a target.
    """
    first = next(iter(responses.values()), np.zeros(0))
    rows = random_rows(np.size(first))[:_ROWS]
    asked = {
        name: _Asked(np.asarray(y, np.float64)[rows], *limits[name], targets[name], contributions.get(name, {}))
        for name, y in responses.items()
        if name in targets and limits.get(name, (None, None)) != (None, None)
    }
    asked = {name: a for name, a in asked.items() if np.unique(a.y[np.isfinite(a.y)]).size > 1}
    if not asked:
        raise ReportError("advice: no response has limits, a target and values that vary; give limits to at least one")
    return tuple(_advice(variable, asked, lambda f, v=variable: widen(v, f, rows)) for variable in variables)  # type: ignore[misc]


def _advice(variable: str, asked: Mapping[str, _Asked], widen: Callable[[float], Change]) -> Advice:
    """Search the largest factor at which no response misses its target."""
    from scipy.optimize import brentq

    def at(factor: float) -> _At:
        return _least_margin(variable, factor, asked, widen(factor))

    now = at(1.0)
    kept_at, missed_at = (1.0, MOST_FACTOR) if now.margin >= 0 else (LEAST_FACTOR, 1.0)
    kept, missed = (now, at(missed_at)) if now.margin >= 0 else (at(kept_at), now)
    if kept.margin < 0:
        return Advice(variable, None, True, kept.response, kept.cpk, kept.method, kept.effective)
    if missed.margin >= 0:
        return Advice(variable, missed_at, False, missed.response, missed.cpk, missed.method, missed.effective)
    # A step on the safe side of the root; at a target that is just met, none.
    root = float(brentq(lambda f: at(f).margin, kept_at, missed_at, rtol=_PRECISION)) if kept.margin > 0 else kept_at
    factor = max(root * (1 - _PRECISION), kept_at)
    found = at(factor)
    return Advice(variable, factor, True, found.response, found.cpk, found.method, found.effective)


def _least_margin(variable: str, factor: float, asked: Mapping[str, _Asked], change: Change) -> _At:
    """Return the response with the least margin of Cpk over its target."""
    spread = factor if change.spread is None else change.spread
    limits = {name: (response.lsl, response.usl) for name, response in asked.items()}
    answers = what_if_all({name: response.y for name, response in asked.items()}, change, limits)
    found = []
    for name, response in asked.items():
        reweighted = answers[name].cpk
        modelled = response.cpk(1 + (response.shares.get(variable) or 0.0) * (spread**2 - 1))
        if reweighted is not None:
            cpk, method, effective = reweighted.value, REWEIGHTING, answers[name].effective
        elif modelled is not None:
            cpk, method, effective = modelled, CONTRIBUTIONS, None
        else:  # nothing can widen what does not vary
            continue
        found.append(_At(cpk - response.target, name, cpk, method, effective))
    return min(found, key=lambda f: f.margin) if found else _At(np.inf, "", np.inf, CONTRIBUTIONS, None)


def _minus(high: float | None, low: float | None) -> float | None:
    """Return a difference, None if an end is missing."""
    return None if high is None or low is None else high - low
