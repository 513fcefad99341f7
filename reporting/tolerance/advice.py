"""How far the spread of one variable may grow while every response keeps its target index.

The index at another spread follows from reweighting the campaign's samples, as long as the weights are reliable. Beyond
that it follows from a polynomial of the variables, where one explains the responses; otherwise the advice ends there.
Either way the joint distribution changes: the copula of correlated variables stays as it is.

The interval of a factor holds every factor at which the interval of the index holds the target.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting.arrays import random_rows
from reporting.errors import ReportError
from reporting.tolerance.index_curve import IndexCurve, Question
from reporting.tolerance.reweighting import Change
from reporting.tolerance.weighted_intervals import LotLabels

REWEIGHTING, REGRESSION = "reweighting", "regression"
MOST_FACTOR, LEAST_FACTOR = 4.0, 0.05
BY_SAMPLES, BY_BOUNDS, BY_SEARCH = "samples", "bounds", "search"
_PRECISION = 5e-4  # of a factor
ADVISED_ROWS = 20_000  # determine a Cpk of 1.33 to 0.6 %

Rows = NDArray[np.intp]
Widen = Callable[[str, float, Rows], Change]


@dataclass(frozen=True)
class Advice:
    """How far the spread of one variable may change while the others stay as they are.

    Attributes
    ----------
    variable : str
    factor : float or None
        Largest factor on the standard deviation that the variable has, cut at its bounds. Below 1 the spread must
        shrink for the responses to reach their targets; None: no factor down to `reach` makes them reach their targets.
        It is never larger than the variable's bounds and the mechanism allow.
    interval : (float or None, float or None)
        Of the factor; an end is None where the samples do not show it.
    bounded : bool
        False if no response is seen to fall below its target up to `reach`: the factor is at least the lower end of its
        interval.
    ended_by : str
        Why an advice that is not bounded ends at `reach`: "samples" (they say nothing of a larger factor), "bounds" (of
        the variable, or the mechanism, allow none: `limit`), "search" (the largest that is tried); otherwise empty.
    reach : float
        Outermost factor, above or below 1, that could be answered.
    binding : str or None
        The response that limits the factor, or that misses its target; or "runs without a value".
    cpk : float or None
        Cpk of that response, at the factor.
    method : str
        How the index at the factor was found: "reweighting" or "regression".
    effective : float or None
        Effective sample size at the factor; None without reweighting.
    refusal : str
        Why there is no advice; empty if there is.
    limit : str
        What allows no larger factor than `reach`, where bounds or the mechanism do.
    settings : tuple of str
        What to write in the campaign file for the factor, each ``VARIABLE.KEY=VALUE``, as ``clearcap whatif --set``
        takes it.
    below : dict of str to float
        Cpk at the factor of the responses that miss their targets already, if it makes them worse.
    """

    variable: str
    factor: float | None
    interval: tuple[float | None, float | None]
    bounded: bool
    ended_by: str
    reach: float
    binding: str | None
    cpk: float | None
    method: str
    effective: float | None
    refusal: str = ""
    limit: str = ""
    settings: tuple[str, ...] = ()
    below: dict[str, float] = field(default_factory=dict)


def advise(
    responses: Mapping[str, ArrayLike],
    limits: Mapping[str, tuple[float | None, float | None]],
    targets: Mapping[str, float],
    columns: Mapping[str, ArrayLike],
    variables: Sequence[str],
    widen: Widen,
    confidence: float = 0.95,
    lots: LotLabels | None = None,
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
    columns : mapping of str to array_like, each of shape (n,)
        All variables at each sample.
    variables : sequence of str
        Variables that the advice is for.
    widen : callable (variable, factor, rows) -> Change
        Change of the density at these rows when the standard deviation of the variable is multiplied by the factor.
        Where the variable's bounds allow no such factor, `Change.spread` is the largest that they do.
    confidence : float
        Confidence of the intervals, two-sided.
    lots : array, shape (n,), or None
        Production lot of each sample.

    Raises
    ------
    ReportError
        No response has both limits and a target.
    """
    rows = random_rows(np.size(next(iter(responses.values()), np.zeros(0))))[:ADVISED_ROWS]
    question = asked(responses, limits, targets, columns, rows, confidence, lots)
    return tuple(advise_one(variable, question, lambda f, v=variable: widen(v, f, rows)) for variable in variables)  # type: ignore[misc]


def asked(
    responses: Mapping[str, ArrayLike],
    limits: Mapping[str, tuple[float | None, float | None]],
    targets: Mapping[str, float],
    columns: Mapping[str, ArrayLike],
    rows: Rows,
    confidence: float,
    lots: LotLabels | None,
) -> Question:
    """Return what an advice is asked: the responses with limits, a target and values that vary, at some rows.

    Raises
    ------
    ReportError
        There is no such response.
    """
    limited = {
        name: np.asarray(y, np.float64)[rows]
        for name, y in responses.items()
        if name in targets and limits.get(name, (None, None)) != (None, None)
    }
    varying = {name: y for name, y in limited.items() if np.unique(y[np.isfinite(y)]).size > 1}
    if not varying:
        raise ReportError(
            "advice: no response has limits, a target Cpk and values that vary; give limits to at least one"
        )
    inputs = {name: np.asarray(x, np.float64)[rows] for name, x in columns.items()}
    return Question(
        responses=varying,
        limits=limits,
        targets=targets,
        columns={name: x for name, x in inputs.items() if np.ptp(x) > 0},
        confidence=confidence,
        lots=None if lots is None else lots[rows],
    )


def advise_one(variable: str, question: Question, widen: Callable[[float], Change]) -> Advice:
    """Return the factor by reweighting, or by regression where the samples cannot be reweighted so far.

    Parameters
    ----------
    variable : str
        The variable that changes, or a name for several that change together.
    question : Question
    widen : callable (factor) -> Change
        See `advise`.
    """
    changed = cache(widen)
    most, least = _end(changed(MOST_FACTOR), MOST_FACTOR), _end(changed(LEAST_FACTOR), LEAST_FACTOR)
    limit = changed(MOST_FACTOR).limit
    if most == least == 1:
        return _refused(variable, REWEIGHTING, limit)
    found = _by_samples(variable, question, changed, (least, most))
    if found.ended_by == BY_BOUNDS or (found.ended_by and most == 1):
        found = replace(found, ended_by=BY_BOUNDS, limit=limit or "the variable's bounds allow no more")
    return found if found.factor in (None, 1.0) else replace(found, settings=changed(found.factor).settings)


def _by_samples(
    variable: str, question: Question, changed: Callable[[float], Change], ends: tuple[float, float]
) -> Advice:
    """Return the factor between the ends that are possible, by reweighting or beyond its reach by regression."""
    ended = BY_BOUNDS if ends[1] < MOST_FACTOR else BY_SEARCH
    reweighted = IndexCurve(cache(lambda f: question.reweighted(changed(f))), *ends)
    weighted = _read(variable, reweighted, REWEIGHTING, ends[1], ended)
    if weighted.factor is not None and (weighted.bounded or weighted.ended_by != BY_SAMPLES):
        return weighted
    curve = IndexCurve(cache(lambda f: question.modelled(variable, changed(f), f)), *ends)
    modelled = _read(variable, curve, REGRESSION, ends[1], ended)
    if modelled.refusal or (not weighted.refusal and not _farther(modelled, weighted, reweighted)):
        return weighted
    return modelled


def _end(change: Change, asked: float) -> float:
    """Return the factor that is possible where one is asked for: between 1 and it."""
    possible = change.spread or asked
    return min(max(possible, 1.0), asked) if asked > 1 else max(min(possible, 1.0), asked)


def _undecided(response: str, reach: float) -> str:
    """Return why a factor is 1 although the estimate keeps the targets farther."""
    words = f"the Cpk interval of {response} already reaches below its target"
    return f"{words}; by the estimate alone all targets hold up to {reach:.3g}" if reach > 1 else words


def _refused(variable: str, method: str, refusal: str) -> Advice:
    """Return that there is no advice."""
    return Advice(variable, None, (None, None), True, "", 1.0, None, None, method, None, refusal)


def _farther(modelled: Advice, weighted: Advice, reweighted: IndexCurve) -> bool:
    """Return whether regression answers beyond the reach of the weights, and does not contradict them within it."""
    if weighted.factor is None:
        return modelled.reach < weighted.reach and (modelled.factor is None or modelled.factor <= weighted.reach)
    if modelled.factor is None:
        return False
    if not modelled.bounded:
        return modelled.factor > weighted.factor
    # within their reach the weights must say the same of the factor: their interval of the index holds the target
    return modelled.factor >= weighted.reach or reweighted.at(modelled.factor).low < 0


def _read(variable: str, curve: IndexCurve, method: str, most: float, ended: str) -> Advice:
    """Return the advice that a curve gives."""
    if curve.refusal:
        return _refused(variable, method, curve.refusal)
    keeps = curve.now.value >= 0
    reach = curve.ends[1] if keeps else curve.ends[0]
    low, value, high = (curve.crossing(level) for level in ("low", "value", "high"))
    if low is None:
        low = reach if curve.now.low >= 0 else curve.ends[0]
    bounded = value is not None or not keeps
    if value is not None:
        value *= 1 - _PRECISION  # on the safe side of the crossing
    elif keeps:
        value = max(low, 1.0)
    margin = curve.at(reach if value is None else value)
    undecided = not bounded and low < 1
    return Advice(
        variable=variable,
        factor=value,
        interval=(None if value is None else low, high),
        bounded=bounded,
        ended_by="" if bounded else BY_SAMPLES if undecided or reach < most else ended,
        reach=reach,
        binding=margin.response,
        cpk=margin.cpk,
        method=method,
        effective=margin.effective,
        limit=_undecided(margin.response, reach) if undecided else "",
    )
