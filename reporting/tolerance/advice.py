"""Advice on tolerances from the samples: spreads that must shrink for responses below target, and that may grow.

There are three questions, each on one variable while the others stay as they are:

1. For each response below the target: how far must the variable's spread shrink to reach it? And how far must the
   spreads of all variables shrink together?
2. For the responses at the target: how far may the variable's spread grow while all of them stay there?
3. What would be the effect of that growth on the responses below the target?

The index at another spread is the one that a what-if gives there: by the weights of the campaign's samples, and where
these carry no answer by an emulator of the rows, if it predicts well; otherwise the advice ends there. In both cases
the joint distribution changes, but the copula of correlated variables stays the same.

A response has its target if the index that decides its verdict has. Where that is less than Cpk, as of values with a
heavy tail, more than the required Cpk is asked for, in the ratio of the two. Where it is more, as of bounded values,
the response may be capable at a lower Cpk, by the shape of its values; as another spread changes the shape, the advice
does not promise to keep such a response, but says what becomes of it.

The interval of a factor contains every factor at which the interval of the index contains the target.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting.arrays import Array, random_rows
from reporting.errors import ReportError
from reporting.tolerance.index_curve import MOST_FAILED, ROUNDING, Emulation, Ends, Found, IndexCurve, Limits, Question
from reporting.tolerance.reweighting import Change, LotLabels

REWEIGHTING, EMULATION = "reweighting", "emulation"
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
    method: str  # for the index at the factor: "reweighting" or "emulation"
    effective: float | None  # sample size at the factor; None without reweighting
    refusal: str = ""  # why there is no advice; empty if there is
    limit: str = ""  # what prevents a factor beyond `reach`, if it is the bounds or the mechanism
    settings: tuple[str, ...] = ()  # of the campaign file for the factor, each ``VARIABLE.KEY=VALUE``
    written: tuple[str, ...] = ()  # the same, rounded to the digits of a drawing: to 1 % of the new sigma
    # Cpk at the factor of responses that are below their targets, if the factor makes them worse
    below: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class DecidingIndex:
    """The index that decides the verdict on a response, with its Cpk."""

    cpk: float | None  # None if undefined
    value: float | None  # None where Cpk decides; infinite where no share lies out of limits
    required: float

    @property
    def reached(self) -> bool:
        """Whether the index is at least the required one."""
        found = self.cpk if self.value is None else self.value
        return found is not None and found >= self.required

    @property
    def target(self) -> float:
        """The Cpk to aim at: the required index, or more if the values need more Cpk for it."""
        if self.cpk is None or self.value is None or not 0 < self.value < self.cpk:
            return self.required
        return self.required * self.cpk / self.value

    @property
    def by_shape(self) -> bool:
        """Whether the index is reached although Cpk is below its target."""
        return self.reached and self.cpk is not None and self.cpk < self.target


@dataclass(frozen=True)
class Shortfall:
    """A response below its target, and the changes that lift it there."""

    response: str
    cpk: float  # present
    target: float  # required of Cpk
    index: float  # present one that decides the verdict
    required: float  # of that index
    centred: float | None  # Cpk with the mean in the middle between the limits; None with one limit
    alone: tuple[Advice, ...]  # for each variable, how far its spread must shrink while the others stay
    # common factor by which the spreads of all variables must shrink; None if there is nothing to shrink
    together: Advice | None
    text: str  # recommendation in words

    @property
    def aim(self) -> str:
        """The target in words: of Cpk, and of the index that decides where that is another one."""
        return aim_in_words(self.target, self.required)


@dataclass(frozen=True)
class ToleranceAdvice:
    """Advice on tolerances."""

    kept: tuple[str, ...] = ()  # responses at their target, which stay there in spite of the growth
    kept_at: str = ""  # their target in words
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
    varied: Sequence[str]  # variables whose spread may change
    lots: LotLabels | None = None
    most_failed: float = MOST_FAILED  # share of runs without a value above which there is no verdict, and no advice
    emulation: Emulation | None = None  # of all responses and varying variables; None where it does not apply


def tolerance_advice(
    samples: AdvisedSamples, indices: Mapping[str, DecidingIndex], rescale: Rescale, confidence: float = 0.95
) -> ToleranceAdvice:
    """Return the advice on tolerances from the samples.

    `indices` are those of the responses with limits, over the samples with a value. `rescale` (factors by variable,
    rows) gives the change of the density at the rows if the standard deviations of some variables are multiplied by
    factors.
    """
    known = {name: index for name, index in indices.items() if index.cpk is not None}
    if not known:
        return ToleranceAdvice(note="No advice: no response has limits and values that vary.")
    if not samples.varied:
        return ToleranceAdvice(note="No advice: no variable varies.")
    values = {name: np.asarray(samples.responses[name], np.float64) for name in known}
    failed = max(float(np.mean(~np.isfinite(y))) for y in values.values())
    if failed > samples.most_failed + ROUNDING:
        return ToleranceAdvice(note=_too_many_failed(failed, samples.most_failed))
    cpks, targets = ({name: getattr(index, key) for name, index in known.items()} for key in ("cpk", "target"))
    below = sorted((name for name in known if not known[name].reached), key=lambda name: cpks[name] / targets[name])
    shaped = [name for name in known if known[name].by_shape]
    kept = tuple(name for name in known if name not in (*below, *shaped))
    rows = random_rows(next(iter(values.values())).size)[:ADVISED_ROWS]

    def question(names: Sequence[str]) -> Question:
        of = {name: values[name] for name in names}
        return asked(of, samples.limits, targets, rows, confidence, samples.lots, samples.emulation)

    # Variables whose spread can shrink as far as the search goes; one row is enough to ask.
    free = [v for v in samples.varied if rescale({v: LEAST_FACTOR}, rows[:1]).spread in (None, LEAST_FACTOR)]
    together = [ALL_TOGETHER] if len(free) > 1 else []
    alone: dict[str, list[Advice]] = {name: [] for name in below}
    growth: list[Advice] = []
    questions = {name: question([name]) for name in below}
    of_kept, of_missed = (question(names) if names else None for names in (kept, [*below, *shaped]))
    for variable in [*samples.varied, *together]:  # the changes of one variable are used for all questions
        names = free if variable == ALL_TOGETHER else [variable]
        change = lru_cache(_KEPT_CHANGES)(partial(_scaled, rescale, tuple(names), rows))
        for name, asked_of in questions.items():
            alone[name].append(advise_one(variable, asked_of, change, names))
        if of_kept is not None and variable != ALL_TOGETHER:
            found = advise_one(variable, of_kept, change, names)
            growth.append(found if of_missed is None else replace(found, below=_losses(found, of_missed, change, cpks)))
    shortfalls = []
    for name, found_of in alone.items():
        single, all_of = tuple(found_of[: len(samples.varied)]), next(iter(found_of[len(samples.varied) :]), None)
        centred = _centred(values[name], *samples.limits[name])
        text = _remedy(name, values[name], samples.limits[name], (known[name], centred), single, all_of)
        index = cpks[name] if known[name].value is None else float(known[name].value or 0.0)
        shortfalls.append(
            Shortfall(name, cpks[name], targets[name], index, known[name].required, centred, single, all_of, text)
        )
    aims = dict.fromkeys(aim_in_words(known[name].target, known[name].required) for name in kept)
    kept_at = next(iter(aims)) if len(aims) == 1 else "their targets"
    return ToleranceAdvice(kept, kept_at, tuple(growth), tuple(shortfalls), _of_shape(shaped))


def advise(
    responses: Mapping[str, ArrayLike],
    limits: Mapping[str, tuple[float | None, float | None]],
    targets: Mapping[str, float],
    variables: Sequence[str],
    widen: Widen,
    confidence: float = 0.95,
    lots: LotLabels | None = None,
    emulation: Emulation | None = None,
) -> tuple[Advice, ...]:
    """Return the advice on the spread of each variable; raise ReportError if no response has both limits and a target.

    Responses have the shape (n,), NaN where there is no value; those without limits are ignored.
    `widen` (variable, factor, rows) gives the change of the density at the rows if the standard deviation of the
    variable is multiplied by the factor. If its bounds do not allow the factor, `Change.spread` is the largest that
    they allow.
    """
    rows = random_rows(np.size(next(iter(responses.values()), np.zeros(0))))[:ADVISED_ROWS]
    question = asked(responses, limits, targets, rows, confidence, lots, emulation)
    return tuple(advise_one(v, question, lambda f, v=v: widen(v, f, rows), [v]) for v in variables)  # type: ignore[misc]


def asked(
    responses: Mapping[str, ArrayLike],
    limits: Mapping[str, tuple[float | None, float | None]],
    targets: Mapping[str, float],
    rows: Rows,
    confidence: float,
    lots: LotLabels | None,
    emulation: Emulation | None = None,
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
    return Question(
        responses=varying,
        limits=limits,
        targets=targets,
        confidence=confidence,
        lots=None if lots is None else lots[rows],
        emulation=emulation,
    )


def advise_one(variable: str, question: Question, widen: Callable[[float], Change], names: Sequence[str]) -> Advice:
    """Return the factor on the spreads of `names`, which are `variable` or all that change together under this name."""
    changed = cache(widen)
    most, least = _end(changed(MOST_FACTOR), MOST_FACTOR), _end(changed(LEAST_FACTOR), LEAST_FACTOR)
    limit = changed(MOST_FACTOR).limit
    if most == least == 1:
        return _refused(variable, limit)

    @cache
    def at(factor: float) -> Found:
        return question.at(changed(factor), dict.fromkeys(names, factor))

    def curve(errors: Mapping[str, Ends]) -> IndexCurve:
        return IndexCurve(cache(lambda factor: question.margin(at(factor), errors)), least, most)

    ended, without = BY_BOUNDS if most < MOST_FACTOR else BY_SEARCH, curve({})
    found, asked_at = _read(variable, without, most, ended), without.emulated
    if asked_at is not None:  # the emulator's errors are those where it is asked
        if found.method == EMULATION and found.factor is not None:
            asked_at = found.factor
        errors = question.emulator_errors(dict.fromkeys(names, asked_at))
        found = _read(variable, curve(errors), most, ended)
    if found.ended_by == BY_BOUNDS or (found.ended_by and most == 1):
        found = replace(found, ended_by=BY_BOUNDS, limit=limit or "the variable's bounds allow no more")
    if found.factor in (None, 1.0):
        return found
    change = changed(found.factor)
    return replace(found, settings=change.settings, written=change.written)


def _read(variable: str, curve: IndexCurve, most: float, ended: str) -> Advice:
    """Return the advice that follows from a curve."""
    if curve.refusal:
        return _refused(variable, curve.refusal)
    keeps = curve.now.value >= 0
    reach = curve.ends[1] if keeps else curve.ends[0]
    low, value, high = (curve.crossing(level) for level in ("low", "value", "high"))
    if low is None:
        low = reach if curve.now.low >= 0 else curve.ends[0]
    bounded = value is not None or not keeps
    if value is not None:
        value = max(value * (1 - _PRECISION), 1.0 if keeps else 0.0)  # on the safe side of the crossing
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
        method=REWEIGHTING if margin.effective is not None else EMULATION,
        effective=margin.effective,
        limit=_undecided(margin.response, reach) if undecided else "",
    )


def _end(change: Change, asked: float) -> float:
    """Return the possible factor closest to the requested one, between 1 and the requested factor."""
    possible = change.spread or asked
    return min(max(possible, 1.0), asked) if asked > 1 else max(min(possible, 1.0), asked)


def _undecided(response: str, reach: float) -> str:
    """Return why a factor is 1 although the estimate keeps the targets at larger factors."""
    words = f"the Cpk interval of {response} already reaches below its target"
    return f"{words}; by the estimate alone all targets hold up to {reach:.3g}" if reach > 1 else words


def _refused(variable: str, refusal: str) -> Advice:
    """Return an advice without a factor, with the reason."""
    return Advice(variable, None, (None, None), True, "", 1.0, None, None, REWEIGHTING, None, refusal)


def aim_in_words(target: float, required: float) -> str:
    """Return a target of Cpk in words, with the required index that it stands for where that is another one."""
    return f"Cpk {required:.2f}" if target == required else f"Cpk {target:.2f} (index {required:.2f})"


def _scaled(rescale: Rescale, names: Sequence[str], rows: Rows, factor: float) -> Change:
    """Return the change at rows due to a common factor on the standard deviations of some variables."""
    return rescale(dict.fromkeys(names, factor), rows)


def _too_many_failed(failed: float, most: float) -> str:
    """Return why there is no advice if many runs failed."""
    return (
        f"No advice: {100 * failed:.3g} % of the runs have no value, more than {100 * most:.3g} %. They may be "
        "the rejects, and the other runs do not show what tolerances do to them. First find out why they failed."
    )


def _of_shape(names: Sequence[str]) -> str:
    """Return what the advice does with responses that are capable by the shape of their values alone."""
    if not names:
        return ""
    return (
        f"{', '.join(names)}: capable at a lower Cpk, by the shape of the values. Another spread may change that"
        " shape, so the factors do not keep it for sure."
    )


def _losses(
    advice: Advice, missed: Question, change: Callable[[float], Change], now: Mapping[str, float]
) -> dict[str, float]:
    """Return the Cpk of responses that the advice does not keep and that become worse by a growth."""
    if advice.factor is None or advice.factor <= 1:
        return {}
    changed = change(advice.factor)
    if advice.method == REWEIGHTING:
        found = missed.weighted(changed)
        indices = found if isinstance(found, str) else {name: cpk for name, (_, cpk, _) in found[0].items()}
    else:
        indices = missed.emulated({advice.variable: advice.factor})
    if isinstance(indices, str):
        return {}
    return {name: cpk for name, cpk in indices.items() if cpk < now[name] - _SAME_INDEX}


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
    indices: tuple[DecidingIndex, float | None],
    alone: Sequence[Advice],
    together: Advice | None,
) -> str:
    """Return a recommendation for a response below its target, in words."""
    index, centred = indices
    cpk, target = index.cpk or 0.0, index.target
    words = [f"{name} has Cpk {cpk:.4g}, below {target:g}."]
    if index.value is not None and index.value != cpk:
        words = [f"{name} has index {index.value:.4g}, below {index.required:g}, at Cpk {cpk:.4g}."]
        words += [f"Values of this shape need Cpk {target:.4g}."] if target != index.required else []
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
