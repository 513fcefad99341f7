"""Advice on how much the spread of one variable may grow while every response keeps its target index.

The index at another spread follows from reweighting the campaign's samples, as long as the weights are reliable. Beyond
that range it follows from a polynomial of the variables, if one explains the responses; otherwise the advice ends
there. In both cases the joint distribution changes, but the copula of correlated variables stays the same.

The interval of a factor contains every factor at which the interval of the index contains the target.
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
ADVISED_ROWS = 20_000  # enough to determine a Cpk of 1.33 to 0.6 %

Rows = NDArray[np.intp]
Widen = Callable[[str, float, Rows], Change]


@dataclass(frozen=True)
class Advice:
    """Advice on the spread of one variable while the others stay as they are."""

    variable: str
    # Largest factor on the standard deviation of the variable (truncated at its bounds). Below 1 the spread must shrink
    # for the responses to reach their targets; None if no factor down to `reach` achieves this. It is never larger than
    # the variable's bounds and the mechanism allow.
    factor: float | None
    interval: tuple[float | None, float | None]  # of the factor; an end is None if the samples do not determine it
    # False if no response falls below its target up to `reach`: the factor is then at least the lower end of its
    # interval
    bounded: bool
    # Why an unbounded advice ends at `reach`: "samples" (they contain no information on a larger factor), "bounds" (of
    # the variable or the mechanism allow no larger factor, see `limit`), "search" (the largest factor tried); otherwise
    # empty.
    ended_by: str
    reach: float  # farthest factor from 1, above or below, with an answer
    binding: str | None  # the response that limits the factor, or that misses its target; or "runs without a value"
    cpk: float | None  # of that response at the factor
    method: str  # for the index at the factor: "reweighting" or "regression"
    effective: float | None  # sample size at the factor; None without reweighting
    refusal: str = ""  # why there is no advice; empty if there is
    limit: str = ""  # what prevents a factor beyond `reach`, if it is the bounds or the mechanism
    settings: tuple[str, ...] = ()  # of the campaign file for the factor, each ``VARIABLE.KEY=VALUE``
    # Cpk at the factor of responses that already miss their targets, if the factor makes them worse
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
    """Return the advice on the spread of each variable; raise ReportError if no response has both limits and a target.

    All columns have the shape (n,); responses are NaN where there is no value, and those without limits are ignored.
    `widen` (variable, factor, rows) gives the change of the density at the rows if the standard deviation of the
    variable is multiplied by the factor. If its bounds do not allow the factor, `Change.spread` is the largest that
    they allow.
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
    """Return the question of an advice: responses with limits, a target and varying values, at the given rows.

    ReportError: there is no such response.
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
    """Return the factor by reweighting, or by regression if the samples cannot be reweighted far enough.

    `variable` may be a name for several variables that change together.
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
    """Return the factor between the given ends, by reweighting, or by regression beyond the reach of reweighting."""
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
    """Return the possible factor closest to the requested one, between 1 and the requested factor."""
    possible = change.spread or asked
    return min(max(possible, 1.0), asked) if asked > 1 else max(min(possible, 1.0), asked)


def _undecided(response: str, reach: float) -> str:
    """Return why a factor is 1 although the estimate keeps the targets at larger factors."""
    words = f"the Cpk interval of {response} already reaches below its target"
    return f"{words}; by the estimate alone all targets hold up to {reach:.3g}" if reach > 1 else words


def _refused(variable: str, method: str, refusal: str) -> Advice:
    """Return an advice without a factor, with the reason."""
    return Advice(variable, None, (None, None), True, "", 1.0, None, None, method, None, refusal)


def _farther(modelled: Advice, weighted: Advice, reweighted: IndexCurve) -> bool:
    """Return whether regression reaches farther than the weights and does not contradict them within their reach."""
    if weighted.factor is None:
        return modelled.reach < weighted.reach and (modelled.factor is None or modelled.factor <= weighted.reach)
    if modelled.factor is None:
        return False
    if not modelled.bounded:
        return modelled.factor > weighted.factor
    # within their reach the weights must confirm the factor: their interval of the index contains the target
    return modelled.factor >= weighted.reach or reweighted.at(modelled.factor).low < 0


def _read(variable: str, curve: IndexCurve, method: str, most: float, ended: str) -> Advice:
    """Return the advice that follows from a curve."""
    if curve.refusal:
        return _refused(variable, method, curve.refusal)
    keeps = curve.now.value >= 0
    reach = curve.ends[1] if keeps else curve.ends[0]
    low, value, high = (curve.crossing(level) for level in ("low", "value", "high"))
    if low is None:
        low = reach if curve.now.low >= 0 else curve.ends[0]
    bounded = value is not None or not keeps
    if value is not None:
        value *= 1 - _PRECISION  # to be on the safe side of the crossing
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
