"""Verdict on a response: capable, marginal or not capable, by the index of the share beyond its worse limit.

One index decides: the Cpk of a normal response with the share of rejects beyond the worse limit. For values that may be
normal it is Cpk itself; for values that are proven not to be normal it comes from a fitted distribution, else from a
Pareto tail; and from weighted runs where the campaign has them, which assume no distribution. The word is the class of
this estimate. Another estimate of the share, or the count of rejects, replaces it only if its whole interval lies
outside that class: a number that its own interval does not confirm changes no word. An estimate that the count refutes
is ignored.

A verdict is *certain* if the interval of the estimate that decides lies in one class, no other estimate indicates a
worse class, an estimate without the normal distribution excludes the other classes, and so do the values for a second
population that they do not rule out (`reporting.shape.estimates`).

A failed sample has no value and may be a reject. With too many of them there is no verdict at all; with fewer the
verdict is not certain if as many rejects would prove a worse class.

If a customer prescribes Cpk or the percentile index of ISO 22514-2, that index alone decides.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from scipy.special import ndtr, ndtri

from reporting.capability.intervals import Estimate, Interval
from reporting.capability.shares import PPM, Nonconforming, Share, least_ppm
from reporting.capability.summary import Capability
from reporting.format_numbers import grouped, index, ppm, significant

# A response is capable from the first Cpk on and marginal from the second on (AIAG; Montgomery, Introduction to
# Statistical Quality Control).
CAPABLE, MARGINAL = 1.33, 1.00
# Share of normal responses with one limit and Cpk 1.00 called capable: 4 % with 30 values, 8 % with 20, 54 % with two.
FEWEST_FOR_A_VERDICT = 30
NO_PRODUCTION = "The samples do not represent production."
WEIGHTED, PERCENTILE = "rare rejects", "fitted percentiles"  # estimates by these methods
_BEST_FIRST = ("capable", "marginal", "not capable")
# as a headline has them, and lists of campaigns
WORST_FIRST = (
    *("not capable", "not capable, not certain", "marginal", "marginal, not certain"),
    *("capable, not certain", "no verdict"),
)
# Without the normal distribution, the best method first. Percentiles of the values say nothing about a share beyond.
_WITHOUT_NORMAL = ("fitted distribution", "tail")


@dataclass(frozen=True)
class Bars:
    """The indices from which on a response is capable, and marginal, and the index that is asked for."""

    capable: float = CAPABLE
    marginal: float = MARGINAL
    prescribed: str = "share"  # or "cpk" or "percentile", which then alone decides

    def class_of(self, found: float) -> str:
        """Return "capable", "marginal" or "not capable" for an index."""
        return "capable" if found >= self.capable else "marginal" if found >= self.marginal else "not capable"

    def classes(self, interval: Interval) -> tuple[str, ...]:
        """Return the classes that an interval covers, the best first."""
        last, first = (_BEST_FIRST.index(self.class_of(end)) for end in interval)
        return _BEST_FIRST[first : last + 1]


USUAL = Bars()


def bars_of(requirement: float, prescribed: str = "share") -> Bars:
    """Return the bars of a required index: marginal is one sigma less, as 1.00 is of 1.33 and 1.33 of 1.67."""
    sigmas = 3 * requirement
    whole = round(sigmas) if abs(sigmas - round(sigmas)) < 0.02 else sigmas
    return Bars(requirement, round((whole - 1) / 3, 2), prescribed)


@dataclass(frozen=True)
class SecondPopulation:
    """A small second population that the values do not rule out, and what a certain verdict assumes of it."""

    ppm: float  # share of production that it has beyond the worse limit; 0 without one
    words: str  # as the subject of a sentence
    assumes: str  # in a sentence


@dataclass(frozen=True)
class CapabilityVerdict:
    """The verdict on a response and its basis."""

    # "capable", "marginal", "not capable"; "constant" (all values are equal, and within the limits); "no limits"; or
    # "no verdict" (too few values, too many failed samples, or samples that do not represent production).
    word: str
    # Whether the interval of the estimate that decides has the same verdict at both ends and no other estimate
    # contradicts; never where the values drift. None without a verdict.
    certain: bool | None = None
    by: str = ""  # the estimate that decides: "index" (Cpk), or the method of another one; empty without a verdict
    # why there is no verdict, why it is not certain, or why Cpk does not decide, in sentences
    reasons: tuple[str, ...] = ()
    # The index that decides, whose class the verdict is, and its interval; None where it is infinite or there is none.
    index: float | None = None
    index_low: float | None = None
    index_high: float | None = None
    assumes: str = ""  # what a certain verdict rests on besides its interval, in a sentence


def verdict(
    capability: Capability,
    counted: Nonconforming | None,
    others: Iterable[Estimate] = (),
    *,
    production: bool = True,
    normal: bool = True,
    withheld: str = "",
    bars: Bars = USUAL,
    unseen: SecondPopulation | None = None,
) -> CapabilityVerdict:
    """Return the verdict on a response from its indices, its counted rejects and other trustworthy estimates.

    `normal`: the values may be normal; else an estimate without the normal distribution decides. `withheld` says why no
    response gets a verdict. `unseen` is a second population that the values do not rule out.
    """
    if capability.lsl is None and capability.usl is None:
        return CapabilityVerdict("no limits")
    missing = _missing(capability, NO_PRODUCTION if not production else withheld)
    if missing:
        return CapabilityVerdict("no verdict", reasons=(missing,))
    if capability.std == 0:
        return _on_constant(capability, counted)
    assert capability.cpk is not None
    of_index = _of_cpk(capability)
    known = list(others)
    if bars.prescribed != "share":
        percentiles = [other for other in known if other.method == PERCENTILE]
        decides = percentiles[0] if bars.prescribed == "percentile" and percentiles else of_index
        return _concluded(capability, counted, decides, bars)
    count = [] if counted is None else [_by_count(counted)]
    weighted = [other for other in known if other.method == WEIGHTED]
    if weighted and (math.isfinite(weighted[0].value) or len(bars.classes(weighted[0].interval)) == 1):
        decides = _overruling(bars, weighted[0], count)
        return _concluded(capability, counted, decides, bars, assumes=f"{decides.note}.")
    bounds = [other for other in known if other.method in (*_WITHOUT_NORMAL, WEIGHTED)]
    rivals = [*count, *(o for o in bounds if all(o.high >= c.low and o.low <= c.high for c in count))]
    refuted = [] if counted is None else _excluded(capability, counted)
    free = None if normal and not refuted else _without_normal(rivals)
    decides = _overruling(bars, free or of_index, rivals)
    word = bars.class_of(decides.value)
    doubts = [
        f"{other.note}: {bars.class_of(other.value)}."
        for other in rivals
        if other.method != "count" and other is not decides and _worse(bars.class_of(other.value), word)
    ]
    doubts += refuted if decides is of_index else []
    hidden = _unsupported(decides, rivals, word, bars)
    if unseen is not None:
        with_it = bars.class_of(index_of_share(unseen.ppm + PPM * float(ndtr(-3 * decides.value))))
        hidden += [f"{unseen.words}: {with_it}."] if _worse(with_it, word) else []
    assumes = "" if unseen is None or word == _BEST_FIRST[-1] else unseen.assumes
    return _concluded(capability, counted, decides, bars, [*doubts, *([] if doubts else hidden[:1])], assumes)


def _of_cpk(capability: Capability) -> Estimate:
    """Return the estimate that Cpk is; without bounds where its interval is withheld."""
    assert capability.cpk is not None
    if capability.cpk_interval is None:
        return Estimate(capability.cpk, (-math.inf, math.inf), "index", f"Cpk {index(capability.cpk)}")
    low, high = capability.cpk_interval
    words = f"Cpk {index(capability.cpk)} ({index(low)} to {index(high)})"
    return Estimate(capability.cpk, capability.cpk_interval, "index", words)


def _overruling(bars: Bars, leading: Estimate, rivals: Iterable[Estimate]) -> Estimate:
    """Return the estimate that decides: the leading one, unless the whole interval of a rival lies in other classes.

    Of several rivals the worst one counts.
    """
    word = bars.class_of(leading.value)
    against = [other for other in rivals if word not in bars.classes(other.interval) and other is not leading]
    return min(against, key=lambda other: other.value, default=leading)


def _concluded(
    capability: Capability,
    counted: Nonconforming | None,
    decides: Estimate,
    bars: Bars,
    doubts: Iterable[str] = (),
    assumes: str = "",
) -> CapabilityVerdict:
    """Return the verdict by the estimate that decides; any doubt takes its certainty."""
    word, of_index = bars.class_of(decides.value), _of_cpk(capability)
    others = [each for each in _BEST_FIRST if each in bars.classes(decides.interval) and each != word]
    withheld = decides.method != WEIGHTED and capability.cpk_interval is None
    found = [capability.interval_reason] if withheld else []
    found += [f"{decides.note}: may be {word} or {' or '.join(others)}."] if others and not withheld else []
    found += [*doubts, *changed_by_failures(counted, word, bars)]
    if capability.order is not None and capability.order.finding:
        found.append(capability.order.finding)
    instead = []
    if decides.method != "index" and bars.class_of(of_index.value) != word:
        instead = [f"{decides.note}: {word}, although {of_index.note} says {bars.class_of(of_index.value)}."]
    value, low, high = (end if math.isfinite(end) else None for end in (decides.value, decides.low, decides.high))
    reasons = (*instead, *found)
    return CapabilityVerdict(word, not found, decides.method, reasons, value, low, high, "" if found else assumes)


def _on_constant(capability: Capability, counted: Nonconforming | None) -> CapabilityVerdict:
    """Return the verdict on values that are all equal: all keep the limits, or all are rejects."""
    value = significant(capability.mean, 6)
    if capability.ppm_observed:
        return CapabilityVerdict("not capable", True, "count", (f"Every value is {value}, out of limits.",))
    text = f"Every value is {value}, within the limits. Values without a spread have no index."
    return CapabilityVerdict("constant", reasons=(text, *changed_by_failures(counted, "constant")))


def index_of_share(share: float) -> float:
    """Return the Cpk of a normal response with `share` ppm beyond its worse limit; infinite for 0 ppm."""
    return -float(ndtri(min(share, PPM) / PPM)) / 3


def changed_by_failures(counted: Nonconforming | None, word: str, bars: Bars = USUAL) -> list[str]:
    """Return a sentence if the failed samples, counted as rejects, would prove a worse class than `word`."""
    if counted is None or word == _BEST_FIRST[-1]:
        return []
    failed, worse = counted.with_failures.count - counted.total.count, counted.worse_with_failures
    least = bars.class_of(index_of_share(worse.interval[0]))
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


def _by_count(counted: Nonconforming) -> Estimate:
    """Return the estimate from the counted rejects: the worse side with its exact interval.

    Without a reject the value is the low end: no reject among 5,000 proves no better class.
    """
    sides = [side for side in (counted.below, counted.above) if side is not None]
    low = min(index_of_share(side.interval[1]) for side in sides)
    high = min(index_of_share(side.interval[0]) for side in sides)
    value = min(index_of_share(side.ppm) for side in sides)
    return Estimate(value if math.isfinite(value) else low, (low, high), "count", _words(counted.total))


def _without_normal(rivals: Iterable[Estimate]) -> Estimate | None:
    """Return the estimate that decides if the values are not normal: the worst one of the best available method."""
    known = tuple(rivals)
    for method in _WITHOUT_NORMAL:
        found = [estimate for estimate in known if estimate.method == method]
        if found:
            return min(found, key=lambda estimate: estimate.value)
    return None


def _words(total: Share) -> str:
    low, high = total.interval
    return (
        f"{grouped(total.count)} of {grouped(total.n)} values out of limits, {ppm(total.ppm)} ppm "
        f"({ppm(low)} to {ppm(high)})"
    )


def _worse(word: str, than: str) -> bool:
    return _BEST_FIRST.index(word) > _BEST_FIRST.index(than)


def _unsupported(decides: Estimate, rivals: Sequence[Estimate], word: str, bars: Bars) -> list[str]:
    """Return a sentence if no estimate without the normal distribution excludes the other classes.

    Tails may be heavier than normal ones, or end before the limits, which the fitted families seldom do: so only the
    count excludes what is better than a tail says, and count and tail what is better than the others say.
    """
    counted = [estimate for estimate in rivals if estimate.method == "count"]
    ended = counted if decides.method == "tail" else [e for e in rivals if e.method in ("count", "tail")]
    worst, best = (max(rivals, key=lambda e: e.low, default=None), min(ended, key=lambda e: e.high, default=None))
    if decides.method == "index" and worst is not None and _worse(bars.class_of(worst.low), word):
        against = f"{worst.note} does not rule out {bars.class_of(worst.low)}."
        return [f"Cpk assumes a normal distribution; without that, {against}"]
    if decides.method != "count" and best is not None and _worse(word, bars.class_of(best.high)):
        return [f"{best.note} does not rule out {bars.class_of(best.high)}, as the values may end before the limit."]
    return []


def _excluded(capability: Capability, counted: Nonconforming) -> list[str]:
    """Return a sentence if the exact interval of the counted share excludes the share that the index implies."""
    expected, (low, high) = capability.ppm_expected, counted.total.interval
    if expected is None or not math.isfinite(expected) or low <= expected <= high:
        return []
    direction = "more" if expected < low else "fewer"
    words = ppm(expected, least_ppm(capability.n))
    return [f"{_words(counted.total)}: {direction} than the {words} ppm that a normal distribution predicts."]
