"""Advice on tolerances from the samples: spreads that must shrink for responses below target, and that may grow.

There are three questions, each on one variable while the others stay as they are:

1. For each response below the target: how far must the variable's spread shrink to reach it? And how far must the
   spreads of all variables shrink together?
2. For the responses at the target: how far may the variable's spread grow while all of them stay there?
3. What would be the effect of that growth on the responses below the target?

The index at another spread follows from reweighting the campaign's samples, as long as the weights are reliable. Beyond
that range it follows from a polynomial of the variables, if one explains the responses; otherwise the advice ends
there. In both cases the joint distribution changes, but the copula of correlated variables stays the same.

The interval of a factor contains every factor at which the interval of the index contains the target.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting.arrays import Array, random_rows
from reporting.errors import ReportError
from reporting.tolerance.index_curve import MOST_FAILED, ROUNDING, IndexCurve, Limits, Question
from reporting.tolerance.reweighting import Change, LotLabels

REWEIGHTING, REGRESSION = "reweighting", "regression"
MOST_FACTOR, LEAST_FACTOR = 4.0, 0.05
BY_SAMPLES, BY_BOUNDS, BY_SEARCH = "samples", "bounds", "search"
_PRECISION = 5e-4  # of a factor
ADVISED_ROWS = 20_000  # enough to determine a Cpk of 1.33 to 0.6 %

ALL_TOGETHER = "all variables together"
_KEPT_CHANGES = 64  # changes of one variable cached for the next question
_SAME_INDEX = 1e-3  # a smaller loss of Cpk is ignored

Rows = NDArray[np.intp]
Widen = Callable[[str, float, Rows], Change]
Rescale = Callable[[Mapping[str, float], Rows], Change]


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
    written: tuple[str, ...] = ()  # the same, rounded to the digits of a drawing: to 1 % of the new sigma
    # Cpk at the factor of responses that already miss their targets, if the factor makes them worse
    below: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Shortfall:
    """A response below its target, and the changes that lift it there."""

    response: str
    cpk: float  # present
    target: float  # required
    centred: float | None  # Cpk with the mean in the middle between the limits; None with one limit
    alone: tuple[Advice, ...]  # for each variable, how far its spread must shrink while the others stay
    # common factor by which the spreads of all variables must shrink; None if there is nothing to shrink
    together: Advice | None
    text: str  # recommendation in words


@dataclass(frozen=True)
class ToleranceAdvice:
    """Advice on tolerances."""

    kept: tuple[str, ...] = ()  # responses at their target, which stay there in spite of the growth
    # for each variable, how far its spread may grow; empty if no response is at its target
    growth: tuple[Advice, ...] = ()
    shortfalls: tuple[Shortfall, ...] = ()  # responses below their target, the worst first
    note: str = ""  # why there is no advice, or what it omits


@dataclass(frozen=True)
class AdvisedSamples:
    """The samples on which the advice is based."""

    # all independently drawn samples, including failed ones, shape (n,); NaN without a value
    responses: Mapping[str, ArrayLike]
    limits: Limits
    columns: Mapping[str, Array]  # values of the variables, shape (n,)
    varied: Sequence[str]  # variables whose spread may change
    lots: LotLabels | None = None
    most_failed: float = MOST_FAILED  # share of runs without a value above which there is no verdict, and no advice


def tolerance_advice(
    samples: AdvisedSamples, cpks: Mapping[str, float | None], target: float, rescale: Rescale, confidence: float = 0.95
) -> ToleranceAdvice:
    """Return the advice on tolerances from the samples.

    `cpks` are those of the responses with limits, over the samples with a value; None if undefined. Every response must
    have the Cpk `target`. `rescale` (factors by variable, rows) gives the change of the density at the rows if the
    standard deviations of some variables are multiplied by factors.
    """
    known = {name: cpk for name, cpk in cpks.items() if cpk is not None}
    if not known:
        return ToleranceAdvice(note="No advice: no response has limits and values that vary.")
    if not samples.varied:
        return ToleranceAdvice(note="No advice: no variable varies.")
    values = {name: np.asarray(samples.responses[name], np.float64) for name in known}
    failed = max(float(np.mean(~np.isfinite(y))) for y in values.values())
    if failed > samples.most_failed + ROUNDING:
        return ToleranceAdvice(note=_too_many_failed(failed, samples.most_failed))
    below = sorted((name for name, cpk in known.items() if cpk < target), key=lambda name: known[name])
    kept = tuple(name for name in known if name not in below)
    rows = random_rows(next(iter(values.values())).size)[:ADVISED_ROWS]

    def question(names: Sequence[str]) -> Question:
        of = {name: values[name] for name in names}
        return asked(of, samples.limits, dict.fromkeys(of, target), samples.columns, rows, confidence, samples.lots)

    # Variables whose spread can shrink as far as the search goes; one row is enough to ask.
    free = [v for v in samples.varied if rescale({v: LEAST_FACTOR}, rows[:1]).spread in (None, LEAST_FACTOR)]
    together = [ALL_TOGETHER] if len(free) > 1 else []
    alone: dict[str, list[Advice]] = {name: [] for name in below}
    growth: list[Advice] = []
    questions = {name: question([name]) for name in below}
    of_kept, of_missed = (question(names) if names else None for names in (kept, below))
    for variable in [*samples.varied, *together]:  # the changes of one variable are used for all questions
        names = free if variable == ALL_TOGETHER else [variable]
        change = lru_cache(_KEPT_CHANGES)(partial(_scaled, rescale, tuple(names), rows))
        for name, asked_of in questions.items():
            alone[name].append(advise_one(variable, asked_of, change))
        if of_kept is not None and variable != ALL_TOGETHER:
            found = advise_one(variable, of_kept, change)
            growth.append(
                found if of_missed is None else replace(found, below=_losses(found, of_missed, change, known))
            )
    shortfalls = []
    for name, found_of in alone.items():
        single, all_of = tuple(found_of[: len(samples.varied)]), next(iter(found_of[len(samples.varied) :]), None)
        centred = _centred(values[name], *samples.limits[name])
        text = _remedy(name, values[name], samples.limits[name], (known[name], target, centred), single, all_of)
        shortfalls.append(Shortfall(name, known[name], target, centred, single, all_of, text))
    return ToleranceAdvice(kept, tuple(growth), tuple(shortfalls))


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
    """Return the question of an advice: responses with limits, a target and varying values; ReportError without one."""
    limited = {
        name: np.asarray(y, np.float64)[rows]
        for name, y in responses.items()
        if name in targets and limits.get(name, (None, None)) != (None, None)
    }
    varying = {name: y for name, y in limited.items() if np.any(np.isfinite(y)) and np.ptp(y[np.isfinite(y)]) > 0}
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
    """Return the factor by reweighting, or by regression if the samples cannot be reweighted far enough."""
    # `variable` may be a name for several variables that change together.
    changed = cache(widen)
    most, least = _end(changed(MOST_FACTOR), MOST_FACTOR), _end(changed(LEAST_FACTOR), LEAST_FACTOR)
    limit = changed(MOST_FACTOR).limit
    if most == least == 1:
        return _refused(variable, REWEIGHTING, limit)
    found = _by_samples(variable, question, changed, (least, most))
    if found.ended_by == BY_BOUNDS or (found.ended_by and most == 1):
        found = replace(found, ended_by=BY_BOUNDS, limit=limit or "the variable's bounds allow no more")
    if found.factor in (None, 1.0):
        return found
    change = changed(found.factor)
    return replace(found, settings=change.settings, written=change.written)


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


def _scaled(rescale: Rescale, names: Sequence[str], rows: Rows, factor: float) -> Change:
    """Return the change at rows due to a common factor on the standard deviations of some variables."""
    return rescale(dict.fromkeys(names, factor), rows)


def _too_many_failed(failed: float, most: float) -> str:
    """Return why there is no advice if many runs failed."""
    return (
        f"No advice: {100 * failed:.3g} % of the runs have no value, more than {100 * most:.3g} %. They may be "
        "the rejects, and the other runs do not show what tolerances do to them. First find out why they failed."
    )


def _losses(
    advice: Advice, missed: Question, change: Callable[[float], Change], now: Mapping[str, float]
) -> dict[str, float]:
    """Return the Cpk of responses that already miss their targets and become worse by a growth."""
    if advice.factor is None or advice.factor <= 1:
        return {}
    changed = change(advice.factor)
    if advice.method == REWEIGHTING:
        found = missed.weighted(changed)
        indices = found if isinstance(found, str) else found[0]
    else:
        indices = missed.moved(advice.variable, changed, advice.factor)
    if isinstance(indices, str):
        return {}
    return {name: cpk for name, (_, cpk, _) in indices.items() if cpk < now[name] - _SAME_INDEX}


def _centred(y: Array, lsl: float | None, usl: float | None) -> float | None:
    """Return Cpk with the mean in the middle between two limits."""
    if lsl is None or usl is None:
        return None
    return (usl - lsl) / (6 * float(np.nanstd(y, ddof=1)))


def _beyond(y: Array, lsl: float | None, usl: float | None) -> float:
    """Return how far the mean lies beyond the one limit."""
    mean = float(np.nanmean(y))
    return lsl - mean if lsl is not None else mean - (usl or 0.0)


def _remedy(
    name: str,
    y: Array,
    limits: tuple[float | None, float | None],
    indices: tuple[float, float, float | None],
    alone: Sequence[Advice],
    together: Advice | None,
) -> str:
    """Return a recommendation for a response below its target, in words."""
    cpk, target, centred = indices
    words = [f"{name} has Cpk {cpk:.4g}, below {target:g}."]
    lsl, usl = limits
    if cpk < 0:
        words.append("Its mean lies beyond a limit: no smaller tolerance helps.")
        if centred is None or lsl is None or usl is None:
            return " ".join([*words, f"Move the mean, by more than {_beyond(y, lsl, usl):.3g}."])
        shift = (lsl + usl) / 2 - float(np.nanmean(y))
        end = "." if centred >= target else f", still below {target:g}."
        words.append(
            f"Moving the mean by {shift:+.3g}, to the middle of the limits, gives Cpk {centred:.4g} with the present "
            f"tolerances{end}"
        )
        return " ".join(words)
    if centred is not None and lsl is not None and usl is not None and centred >= target:
        shift = (lsl + usl) / 2 - float(np.nanmean(y))
        words.append(
            f"It is off centre: moving the mean by {shift:+.3g}, to the middle of the limits, gives Cpk {centred:.4g}"
            " with the present tolerances."
        )
    helps = sorted((each for each in alone if each.factor is not None), key=lambda each: -(each.factor or 0.0))
    if helps:
        first = helps[0]
        words.append(f"The smallest change that suffices: {first.variable} at {first.factor:.3g} times its σ.")
    elif not all(each.refusal for each in alone):
        words.append("No variable alone suffices.")
    if not helps and together is not None and together.factor is not None:
        words.append(f"All variables together suffice at {together.factor:.3g} times their σ.")
    return " ".join(words)
