"""The outcome of a campaign in a sentence or two: failures first where they decide, then the worst responses."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from reporting.capability.verdict import changed_by_failures
from reporting.format_numbers import grouped
from reporting.samples import OK
from reporting.spec import ReportSpec
from reporting.statuses import failures_in_words, statuses_in_words, why_no_verdict

if TYPE_CHECKING:
    from reporting.assembly import AssemblyShare
    from reporting.response import ResponseAnalysis

WORST_FIRST = (
    *("not capable", "not capable, not certain", "marginal", "marginal, not certain"),
    *("capable, not certain", "no verdict"),
)


def headline(
    spec: ReportSpec,
    counts: Mapping[str, int],
    responses: Sequence["ResponseAnalysis"],
    fit: "AssemblyShare | None" = None,
) -> str:
    """Return the outcome in a sentence or two; `counts` are the finished samples by status.

    Those that cannot be assembled and are judged by a limit of their own, `fit`, are not among them. If they are too
    many, or may be, that comes first.
    """
    lead = f"{fit.words}. " if fit is not None and fit.verdict in ("open", "exceeded") else ""
    return lead + _outcome(spec, counts, responses)


def _outcome(spec: ReportSpec, counts: Mapping[str, int], responses: Sequence["ResponseAnalysis"]) -> str:
    """Return the outcome of the samples that can be assembled."""
    finished, ok = sum(counts.values()), counts.get(OK, 0)
    if not finished:
        return "No sample is computed yet, so there is nothing to judge."
    if not ok:
        return f"All {grouped(finished)} samples failed ({statuses_in_words(counts)}), so there is nothing to judge."
    limited = [r for r in responses if r.spec.lsl is not None or r.spec.usl is not None]
    withheld, failed = why_no_verdict(counts, spec.min_ok), failures_in_words(counts)
    if not limited or not spec.design.production:
        leads = ok < finished if spec.corners else bool(withheld)  # a corner without a value may be the worst one
        return (f"{failed}. " if leads else "") + _without_verdict(spec, limited)
    if withheld:
        return f"No verdict: {withheld}"
    changed = [r.spec.name for r in limited if changed_by_failures(r.nonconforming, r.verdict.word)]
    missing = failed if ok < finished else "Some values are missing"
    lead = f"{missing}; if they were rejects, the verdict on {', '.join(changed)} would be worse. " if changed else ""
    return lead + _by_verdict(limited)


def _without_verdict(spec: ReportSpec, limited: Sequence["ResponseAnalysis"]) -> str:
    """Return the outcome without verdicts: the worst case, if the samples are corners."""
    if not limited:
        return "No response has limits, so there is nothing to judge."
    corners = [r.worst for r in limited if r.worst is not None]
    if not spec.corners or not corners:
        return "The samples do not represent production, so there is no verdict on capability."
    kept = sum(bool(worst.within) for worst in corners)
    return f"Worst case: {kept} of {len(corners)} responses with limits stay within them at every corner."


def _by_verdict(limited: Sequence["ResponseAnalysis"]) -> str:
    """Return the responses by verdict, the worst first; those with an uncertain verdict form a group of their own."""
    groups: dict[str, list[str]] = {}
    for r in limited:
        word, certain = r.verdict.word, r.verdict.certain
        groups.setdefault(word if certain is not False else f"{word}, not certain", []).append(r.spec.name)
    if list(groups) == ["capable"]:
        return f"Every response with limits is capable ({len(limited)} of {len(limited)})."
    words = [f"{word.capitalize()}: {', '.join(groups[word])}." for word in WORST_FIRST if word in groups]
    if "constant" in groups:
        words.append(f"Constant, within the limits: {', '.join(groups['constant'])}.")
    capable = len(groups.get("capable", ()))
    return " ".join([*words, f"Certainly capable: {capable or 'none'} of {len(limited)} responses with limits."])
