"""Verdict on a response from its indices: capable, marginal or not capable. Every estimate can make it worse.

Cpk decides. Another estimate overrules it if its whole interval lies in a worse class: counted rejects are a fact,
whatever a normal distribution predicts. If the values are proven not to be normal, an estimate without the normal
distribution decides if it is worse. An estimate that the count refutes is ignored. A verdict is *certain* if the
interval of Cpk lies in one class, no estimate indicates a worse class, none proves a better one, and the count does not
exclude the share that the index implies. So the verdict is never better than the class of Cpk, and never certain if
methods disagree. Cpk implies a share only if the tails are normal as far as the limits, which few values cannot show:
therefore the whole interval of an estimate without the normal distribution must also exclude every worse class.

A failed sample has no value and may be a reject. With too many of them there is no verdict at all; with fewer the
verdict is not certain if as many rejects would prove a worse class.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from scipy.special import ndtri

from reporting.capability.shares import PPM, Nonconforming, Share, least_ppm
from reporting.capability.summary import Capability
from reporting.format_numbers import grouped, index, ppm, significant

# A response is capable from the first Cpk on and marginal from the second on (AIAG; Montgomery, Introduction to
# Statistical Quality Control).
CAPABLE, MARGINAL = 1.33, 1.00
# Share of normal responses with one limit and Cpk 1.00 called capable: 4 % with 30 values, 8 % with 20, 54 % with two.
FEWEST_FOR_A_VERDICT = 30
NO_PRODUCTION = "The samples do not represent production."
_BEST_FIRST = ("capable", "marginal", "not capable")


@dataclass(frozen=True)
class IndexEstimate:
    """Estimate of one method for a response, on the scale of Cpk.

    A share of rejects is converted to the Cpk of a normal response with this share beyond its worse limit; infinite
    without rejects.
    """

    by: str  # the method in a word or two
    low: float
    value: float
    high: float
    words: str  # with its numbers, as the subject of a sentence


@dataclass(frozen=True)
class CapabilityVerdict:
    """The verdict on a response and its basis."""

    # "capable", "marginal", "not capable"; "constant" (all values are equal, and within the limits); "no limits"; or
    # "no verdict" (too few values, too many failed samples, or samples that do not represent production).
    word: str
    # Whether the interval of the estimate that decides has the same verdict at both ends and no other estimate
    # contradicts; never where the values drift. None without a verdict.
    certain: bool | None = None
    by: str = ""  # the estimate that decides: "index", or the one that overrules it; empty without a verdict
    # why there is no verdict, why it is not certain, or why it is worse than Cpk, in sentences
    reasons: tuple[str, ...] = ()


def verdict(
    capability: Capability,
    counted: Nonconforming | None,
    others: Iterable[IndexEstimate] = (),
    *,
    production: bool = True,
    normal: bool = True,
    withheld: str = "",
) -> CapabilityVerdict:
    """Return the verdict on a response from its indices, its counted rejects and other trustworthy estimates.

    `production`: the samples represent production. `normal`: the values may be normal; if they are proven not to be, an
    estimate without the normal distribution decides if it is worse than Cpk. `withheld`: a sentence that says why no
    response of the campaign gets a verdict; empty if they may get one.
    """
    if capability.lsl is None and capability.usl is None:
        return CapabilityVerdict("no limits")
    missing = _missing(capability, NO_PRODUCTION if not production else withheld)
    if missing:
        return CapabilityVerdict("no verdict", reasons=(missing,))
    if capability.std == 0:
        return _on_constant(capability, counted)
    assert capability.cpk is not None
    if capability.cpk_interval is None:
        return _without_interval(capability.cpk, capability.interval_reason, counted)
    low, high = capability.cpk_interval
    of_index = IndexEstimate(
        "index", low, capability.cpk, high, f"Cpk {index(capability.cpk)} ({index(low)} to {index(high)})"
    )
    further = _with_count(counted, others)
    word, decides = class_of(of_index.value), of_index
    for other in further:
        if _worse(class_of(other.high), word):
            word, decides = class_of(other.high), other
    free = None if normal else _without_normal(further)
    if free is not None and _worse(class_of(free.value), word):
        word, decides = class_of(free.value), free
    reasons = [*_undecided(decides, word)]
    reasons += [_objection(e, word) for e in further if e is not decides and _objects(e, word)]
    if decides is not of_index:
        how = f"{word} at best" if class_of(decides.high) == word else f"{word}, as the values are not normal"
        reasons.insert(0, f"{decides.words}: {how}, although {of_index.words} says {class_of(of_index.value)}.")
    if counted is not None and decides is of_index:
        reasons += _excluded(capability, counted)
    reasons += changed_by_failures(counted, word)
    if capability.order is not None and capability.order.finding:
        reasons.append(capability.order.finding)
    if not reasons:
        reasons += _unsupported(further, word)
    overruled_only = decides is not of_index and len(reasons) == 1
    return CapabilityVerdict(word, not reasons or overruled_only, decides.by, tuple(reasons))


def _without_interval(cpk: float, reason: str, counted: Nonconforming | None) -> CapabilityVerdict:
    """Return the verdict where the interval of Cpk is withheld, because there are too few production lots."""
    word, by, reasons = class_of(cpk), "index", [reason]
    count = None if counted is None else _by_count(counted)
    if count is not None and _worse(class_of(count.high), word):
        word, by, reasons = class_of(count.high), count.by, [f"{count.words}.", reason]
    return CapabilityVerdict(word, False, by, (*reasons, *changed_by_failures(counted, word)))


def _on_constant(capability: Capability, counted: Nonconforming | None) -> CapabilityVerdict:
    """Return the verdict on values that are all equal: all keep the limits, or all are rejects."""
    value = significant(capability.mean, 6)
    if capability.ppm_observed:
        return CapabilityVerdict("not capable", True, "count", (f"Every value is {value}, out of limits.",))
    text = f"Every value is {value}, within the limits. Values without a spread have no index."
    return CapabilityVerdict("constant", reasons=(text, *changed_by_failures(counted, "constant")))


def class_of(cpk: float) -> str:
    """Return "capable", "marginal" or "not capable" for a Cpk."""
    return "capable" if cpk >= CAPABLE else "marginal" if cpk >= MARGINAL else "not capable"


def index_of_share(share: float) -> float:
    """Return the Cpk of a normal response with `share` ppm beyond its worse limit; infinite for 0 ppm."""
    return -float(ndtri(min(share, PPM) / PPM)) / 3


def changed_by_failures(counted: Nonconforming | None, word: str) -> list[str]:
    """Return a sentence if the failed samples, counted as rejects, would prove a worse class than `word`."""
    if counted is None or word == _BEST_FIRST[-1]:
        return []
    failed, worse = counted.with_failures.count - counted.total.count, counted.worse_with_failures
    least = class_of(index_of_share(worse.interval[0]))
    if not failed or least == _BEST_FIRST[0] or (word in _BEST_FIRST and not _worse(least, word)):
        return []
    return [
        f"{grouped(failed)} of {grouped(worse.n)} samples have no value. If they were rejects, {ppm(worse.ppm)} ppm "
        f"would be out of limits (at least {ppm(worse.interval[0])}): {least}."
    ]


def _missing(capability: Capability, withheld: str) -> str:
    """Return why there is no verdict; empty if there is one."""
    if withheld:
        return withheld
    if capability.n < FEWEST_FOR_A_VERDICT:
        return (
            f"{capability.n} values are too few for a verdict: with fewer than {FEWEST_FOR_A_VERDICT} a response with "
            f"Cpk {MARGINAL:.2f} is too often called capable."
        )
    if capability.std == 0:
        return ""
    if capability.cpk is None or (capability.cpk_interval is None and capability.lots is None):
        return f"There is no Cpk. {' '.join(capability.notes)}"
    return ""


def _by_count(counted: Nonconforming) -> IndexEstimate:
    """Return the estimate from the counted rejects: the worse side with its exact interval.

    The value is the better end of the interval: one reject among 30,000 is no evidence for or against 33 ppm.
    """
    sides = [side for side in (counted.below, counted.above) if side is not None]
    low = min(index_of_share(side.interval[1]) for side in sides)
    high = min(index_of_share(side.interval[0]) for side in sides)
    return IndexEstimate("count", low, high, high, _words(counted.total))


def _with_count(counted: Nonconforming | None, others: Iterable[IndexEstimate]) -> list[IndexEstimate]:
    """Return the estimate from the count, and the estimates that it does not refute."""
    if counted is None:
        return list(others)
    count = _by_count(counted)
    return [count, *(other for other in others if other.high >= count.low and other.low <= count.high)]


def _without_normal(further: list[IndexEstimate]) -> IndexEstimate | None:
    """Return the estimate that decides if the values are not normal: the worst one of the best available method."""
    for method in ("fitted distribution", "tail", "percentiles"):
        found = [estimate for estimate in further if estimate.by == method]
        if found:
            return min(found, key=lambda estimate: estimate.value)
    return None


def _words(total: Share) -> str:
    """Return the count in words."""
    low, high = total.interval
    return (
        f"{grouped(total.count)} of {grouped(total.n)} values out of limits, {ppm(total.ppm)} ppm "
        f"({ppm(low)} to {ppm(high)})"
    )


def _worse(word: str, than: str) -> bool:
    """Return whether a class is worse than another."""
    return _BEST_FIRST.index(word) > _BEST_FIRST.index(than)


def _undecided(estimate: IndexEstimate, word: str) -> list[str]:
    """Return a sentence if the interval of the estimate that decides includes another class."""
    other = [class_of(end) for end in (estimate.low, estimate.high) if class_of(end) != word]
    return [f"{estimate.words}: may be {word} or {' or '.join(dict.fromkeys(other))}."] if other else []


def _objects(estimate: IndexEstimate, word: str) -> bool:
    """Return whether an estimate indicates a worse class, or its whole interval lies in a better one."""
    return _worse(class_of(estimate.value), word) or _worse(word, class_of(estimate.low))


def _objection(estimate: IndexEstimate, word: str) -> str:
    """Return the objection in a sentence."""
    if _worse(word, class_of(estimate.low)):
        return f"{estimate.words}: {class_of(estimate.low)}; the worse of the two counts."
    return f"{estimate.words}: {class_of(estimate.value)}."


def _unsupported(further: list[IndexEstimate], word: str) -> list[str]:
    """Return a sentence if no estimate without the normal distribution excludes the worse classes.

    The percentiles of the values do not count: they say nothing about the shares beyond them.
    """
    shares = (estimate for estimate in further if estimate.by != "percentiles")
    best = max(shares, key=lambda estimate: estimate.low, default=None)
    if best is None or not _worse(class_of(best.low), word):
        return []
    return [f"Cpk assumes a normal distribution; without that, {best.words} does not rule out {class_of(best.low)}."]


def _excluded(capability: Capability, counted: Nonconforming) -> list[str]:
    """Return a sentence if the exact interval of the counted share excludes the share that the index implies."""
    expected, (low, high) = capability.ppm_expected, counted.total.interval
    if expected is None or not math.isfinite(expected) or low <= expected <= high:
        return []
    direction = "more" if expected < low else "fewer"
    words = ppm(expected, least_ppm(capability.n))
    return [f"{_words(counted.total)}: {direction} than the {words} ppm that a normal distribution predicts."]
