"""Advice on tolerances from the samples: spreads that must shrink for responses below target, and that may grow.

There are three questions, each on one variable while the others stay as they are:

1. For each response below the target: how far must the variable's spread shrink to reach it? And how far must the
   spreads of all variables shrink together?
2. For the responses at the target: how far may the variable's spread grow while all of them stay there?
3. What would be the effect of that growth on the responses below the target?
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import ArrayLike

from reporting.arrays import Array, random_rows
from reporting.tolerance.advice import ADVISED_ROWS, LEAST_FACTOR, REWEIGHTING, Advice, Rows, advise_one, asked
from reporting.tolerance.index_curve import MOST_FAILED, ROUNDING, Limits, Question
from reporting.tolerance.reweighting import Change
from reporting.tolerance.weighted_intervals import LotLabels

ALL_TOGETHER = "all variables together"
_KEPT_CHANGES = 64  # changes of one variable cached for the next question
_SAME_INDEX = 1e-3  # a smaller loss of Cpk is ignored

Rescale = Callable[[Mapping[str, float], Rows], Change]


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
        return " ".join([*words, "Its mean lies beyond a limit: no smaller tolerance helps. Move the mean."])
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
