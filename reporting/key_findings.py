"""What a report says in five sentences: the worst response, the yield, its causes, tolerances, and trust.

Each is a sentence or two that stand for a section; the numbers are those of the sections. A sentence is left out where
there is nothing to say: without limits, without a verdict, without variables.
"""

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from reporting import format_numbers
from reporting.capability.verdict import PERCENTILE, WEIGHTED
from reporting.sensitivity.repeatability import NOTABLE_SHARE
from reporting.tolerance.advice import Advice

if TYPE_CHECKING:
    from reporting.analysis import Analysis
    from reporting.response import ResponseAnalysis

# How the index that decides was found.
DECIDING = {
    "index": "Cpk",
    "fitted distribution": "by the fitted distribution",
    "tail": "by the tail",
    "count": "by the count of rejects",
    PERCENTILE: "by percentiles (ISO 22514-2)",
    WEIGHTED: "by weighted runs",
}
UNFIT = "samples that cannot be assembled"
_NAMED = 3  # variables, or checks, in a sentence
_BRACKET, _LINE = 30, 150  # letters of a bracket that is left out, and of what is said of a finding
_NOTABLE = 0.01  # share of the variance of a cause that is named


@dataclass(frozen=True)
class KeyFinding:
    """One of the sentences."""

    about: str  # "Worst", "Yield", "Causes", "Tolerances" or "Trust"
    text: str
    level: str = ""  # of "Trust": the worst level of the trust card


def key_findings(analysis: "Analysis") -> tuple[KeyFinding, ...]:
    """Return the sentences that apply, in reading order."""
    worst = weakest(analysis)
    found = [
        KeyFinding("Worst", _worst(worst) if worst else ""),
        KeyFinding("Yield", _yield(analysis)),
        KeyFinding("Causes", _causes(worst) if worst else ""),
        KeyFinding("Tolerances", _tolerances(analysis) if worst else ""),
        _trust(analysis),
    ]
    return tuple(each for each in found if each.text)


def weakest(analysis: "Analysis") -> "ResponseAnalysis | None":
    """Return the response whose index is smallest compared with its requirement; None without a verdict.

    An index without a verdict says nothing: Cpk of two values is no number to lead with.
    """
    judged = [r for r in analysis.responses if r.verdict.by and r.index is not None and analysis.design.production]
    return min(judged, key=lambda r: (r.index or 0.0) / r.spec.requirement, default=None)


def _worst(response: "ResponseAnalysis") -> str:
    """Return the deciding index of a response with its interval and requirement."""
    found, index = response.verdict, response.index or 0.0
    what = "Cpk" if found.by == "index" else "index"
    value = "no reject" if math.isinf(index) else f"{what} {format_numbers.index(index)}"
    interval = ""
    if found.index_low is not None:
        interval = f" ({format_numbers.index_interval((found.index_low, found.index_high))})"
    uncertain = ", not certain" if found.certain is False else ""
    required = format_numbers.plain(response.spec.requirement)
    by = "" if found.by == "index" else f" {DECIDING[found.by]}"
    return f"{response.spec.name}, {value}{interval}{by}; required {required}: {found.word}{uncertain}."


def _yield(analysis: "Analysis") -> str:
    """Return the counted yield of the product; failed samples count as rejects."""
    product = analysis.product
    if product is None or not product.with_failures.n:
        return ""
    unfit = analysis.finished - analysis.ok - analysis.failed
    lost = [what for what, n in (("failed samples", analysis.failed), (UNFIT, unfit)) if n]
    counted = product.with_failures if lost else product.counted or product.with_failures
    parts = "parts" if analysis.spec.measured else "samples"
    low, high = (format_numbers.percent(end) for end in counted.interval)
    failed = f", {' and '.join(lost)} counted as rejects" if lost else ""
    return (
        f"{format_numbers.percent(counted.share)} ({low} to {high}) of {format_numbers.grouped(counted.n)} {parts} "
        f"keep all limits{failed}."
    )


def _causes(response: "ResponseAnalysis") -> str:
    """Return the variables that drive a response, and the scatter that none causes."""
    if response.sensitivity is None:
        return ""
    name = response.spec.name
    strongest = [i for i in response.sensitivity.ranked if (i.share or 0.0) >= _NOTABLE][:_NAMED]
    shares = [f"{i.variable} ({format_numbers.part(i.share)} of its variance)" for i in strongest[:1]]
    shares += [f"{i.variable} ({format_numbers.part(i.share)})" for i in strongest[1:]]
    text = f"{name} is driven by {_listed(shares)}." if shares else f"No variable alone drives {name}."
    scatter = response.sensitivity.scatter
    if scatter is not None and scatter >= NOTABLE_SHARE:
        text += f" {format_numbers.part(scatter)} is spread that tolerances cannot reduce."
    return text


def _tolerances(analysis: "Analysis") -> str:
    """Return which spreads must shrink, and which may grow."""
    sentences = []
    if analysis.shortfalls:
        short = analysis.shortfalls[0]
        ways = [a for a in short.alone if a.factor is not None and not a.refusal]
        if ways:
            least = max(ways, key=lambda a: a.factor or 0.0)
            sentences.append(
                f"Tightening {least.variable} to {_times(least)} × σ would bring {short.response} to {short.aim}."
            )
        elif short.centred is not None and short.centred >= short.target:
            sentences.append(
                f"No smaller tolerance alone brings {short.response} to {short.aim}; centring its mean would "
                f"(Cpk {format_numbers.index(short.centred)})."
            )
        else:
            sentences.append(f"No single tolerance brings {short.response} to {short.aim}.")
    growing = [a for a in analysis.advice if not a.refusal and a.factor is not None and a.factor > 1]
    growing.sort(key=lambda a: -(a.factor or 0.0))
    if growing:
        each = _listed([f"{a.variable} ({_times(a)} × σ)" for a in growing[:_NAMED]])
        kept = "all responses keep" if not analysis.shortfalls else "the other responses keep"
        sentences.append(f"One at a time, these tolerances could be looser while {kept} {analysis.kept_at}: {each}.")
    elif analysis.advice:
        sentences.append("No tolerance can be looser.")
    return " ".join(sentences)


def _times(advice: Advice) -> str:
    least = "at least " if not advice.bounded and (advice.factor or 0.0) > 1 else ""
    return f"{least}{format_numbers.significant(advice.factor, 2)}"


def _trust(analysis: "Analysis") -> KeyFinding:
    """Return whether the trust card has something against the numbers, and what comes first."""
    bad = [check for check in analysis.trust if check.level == "bad"]
    open_ = [check for check in analysis.trust if check.level == "attention"]
    good = sum(check.level == "good" for check in analysis.trust)
    if bad:
        text = f"Do not rely on these numbers. {bad[0].name}: {short_form(bad[0].text)}"
        return KeyFinding("Trust", text, "bad")
    if open_:
        more = [f"{len(open_) - _NAMED} more"] if len(open_) > _NAMED else []
        names = _listed([*(check.name for check in open_[:_NAMED]), *more])
        ask = "asks" if len(open_) == 1 else "ask"
        text = f"Read with care: {names} {ask} for attention. {short_form(open_[0].text)}"
        return KeyFinding("Trust", text, "attention")
    counted = "1 check is" if good == 1 else f"{good} checks are"
    return KeyFinding("Trust", f"Nothing speaks against these numbers: {counted} good.", "good")


def first_sentence(text: str) -> str:
    """Return the first sentence of a text; the point of a number ends none."""
    return re.split(r"(?<=[.!?]) (?=[A-Z])", text, maxsplit=1)[0]


def short_form(text: str) -> str:
    """Return what a finding says first: its first sentence without long brackets, or as many clauses as fit a line."""
    sentence = re.sub(rf" \([^()]{{{_BRACKET},}}\)", "", first_sentence(text))
    if len(sentence) <= _LINE:
        return sentence
    ends = [found.start() for found in re.finditer(r"[;:] (?![^(]*\))", sentence)]
    if not ends:
        return sentence
    return f"{sentence[: max((end for end in ends if end <= _LINE), default=ends[0])]}."


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""
