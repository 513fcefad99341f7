"""The analysis of a campaign as frozen data; every file of the report renders this one model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from reporting.arrays import Array, random_rows
from reporting.capability.intervals import Estimate
from reporting.capability.verdict import WORST_FIRST, changed_by_failures
from reporting.comparison import Comparison, compare
from reporting.emulation.emulated_tolerances import EmulatedTolerances
from reporting.errors import ReportError
from reporting.format_numbers import grouped
from reporting.inputs import (
    CorrelationAnalysis,
    FailedAgainstOk,
    VariableAnalysis,
    analyse_correlations,
    analyse_variable,
    failed_against_ok,
)
from reporting.product_yield import (
    AssemblyShare,
    ProductYield,
    ResponseCorrelation,
    assembled,
    assembly_share,
    product_yield,
    response_correlations,
)
from reporting.rare.rare_rejects import RareRejects, decisive, rare_estimates, rare_rejects
from reporting.response import ResponseAnalysis, analyse_response
from reporting.samples import (
    OK,
    FailedSample,
    Repeats,
    Samples,
    StatusCount,
    count_statuses,
    counts_by_status,
    failures_in_words,
    leveled_samples,
    list_failures,
    read_samples,
    statuses_in_words,
    why_no_property,
    why_no_verdict,
)
from reporting.sensitivity.influence import ResponseSensitivity, Sensitivity
from reporting.sensitivity.repeatability import repeatabilities
from reporting.sensitivity.summary import Known, sensitivity
from reporting.sensitivity.total_order import independent_draws, total_order
from reporting.spec import Design, ReportSpec
from reporting.tolerance.advice import (
    ADVISED_ROWS,
    Advice,
    AdvisedSamples,
    DecidingIndex,
    Shortfall,
    ToleranceAdvice,
    tolerance_advice,
)
from reporting.tolerance.reweighting import Change
from reporting.trust.card import repeatable, trust_checks
from reporting.trust.checks import Check
from reporting.trust.evidence import rare_checks

if TYPE_CHECKING:
    from reporting.samples import Rows

CONFIDENCE = 0.95


@dataclass(frozen=True)
class OtherSpreads:
    """The variables of a campaign with their standard deviations multiplied by factors, for advice on tolerances."""

    # factors and the samples of the variables, shape (n,), to the change of the density at each sample
    change: Callable[[Mapping[str, float], Mapping[str, Array]], Change]
    # factors to new samples of the variables, shape (m,); None if no emulator applies to them, as with lots
    drawn: Callable[[Mapping[str, float]], Mapping[str, Array]] | None = None


@dataclass(frozen=True)
class Decision:
    """Weighted runs of another campaign on the same mechanism that decide what the samples leave open."""

    rows: "Rows"
    spec: ReportSpec
    responses: tuple[str, ...]  # those that are open


@dataclass(frozen=True)
class Analysis:
    """Everything that a report contains."""

    spec: ReportSpec
    headline: str  # the outcome in a sentence or two: failures first where they decide, then what is bad
    design: Design  # how the samples were drawn, and what follows for the report
    finished: int  # samples
    ok: int  # of the finished samples
    failed: int  # of the finished samples; not those that cannot be assembled, where a limit judges them
    used: int  # ok samples in the statistics: all, or those of A and B in Saltelli's design
    run_seconds: float | None  # total time of the runs [s]
    statuses: tuple[StatusCount, ...]
    trust: tuple[Check, ...]  # the trust card
    responses: tuple[ResponseAnalysis, ...]
    rare: RareRejects | None  # shares of a few ppm from the weighted runs of importance sampling; None for others
    product: ProductYield | None  # samples that keep all limits together; None without limits, or if not production
    assembly: AssemblyShare | None  # samples whose parts cannot be assembled; None without one and without a limit
    variables: tuple[VariableAnalysis, ...]
    correlations: tuple[CorrelationAnalysis, ...]  # the requested ones, and the largest of the others
    response_correlations: tuple[ResponseCorrelation, ...]  # of the responses with each other, the strongest first
    never_critical: tuple[str, ...]  # variables that are not critical for any response
    advice: tuple[Advice, ...]  # how much each spread may grow while the responses `kept` keep their targets
    kept: tuple[str, ...]  # responses that have their required index now
    kept_at: str  # in words, such as "Cpk 1.33"
    shortfalls: tuple[Shortfall, ...]  # responses with a lower index, the worst first, and what must shrink for each
    advice_note: str  # why there is no advice; empty if there is
    failures: tuple[FailedSample, ...]  # the first failed samples
    failed_against_ok: tuple[FailedAgainstOk, ...]  # what separates them, by variable; empty without failed or ok ones
    comparison: Comparison | None  # with another campaign
    confidence: float  # of all intervals


def analyse(
    samples: Samples,
    spec: ReportSpec,
    spreads: OtherSpreads | None = None,
    against: "tuple[Rows, ReportSpec] | None" = None,
    repeats: Repeats | None = None,
    decided: Sequence[Decision] = (),
) -> Analysis:
    """Return the analysis of a finished or running campaign; raise ReportError if rows or limits are wrong.

    `against` is another campaign; of corners only the worst case is shown. `repeats` were simulated
    with half the step. `decided` are weighted runs; of those on one response the last that give an interval decide it.
    """
    samples, rounding = leveled_samples(samples, spec)
    every, samples = samples, assembled(samples, spec)
    spec = _without_boundaries(spec, samples)
    other = None if against is None else _drawn(*against)
    corners = next((pair for pair in ((samples, spec), other) if pair and pair[1].corners), None)
    if other is corners:  # corners do not represent production: only their worst case is shown
        other = None
    drawn, (rare, weighted) = independent_draws(samples, spec), _rare(samples, spec, decided)
    counts, fit = counts_by_status(samples), assembly_share(every, spec, CONFIDENCE)
    scatter, totals = repeatabilities(repeats, samples, drawn, spec, CONFIDENCE), total_order(samples, spec)
    known = {r.name: Known(totals.get(r.name), scatter.get(r.name)) for r in spec.responses}
    influences, withheld = _sensitivity(drawn, spec, known), why_no_verdict(counts, spec.min_ok)
    by_response = {r.response: r for r in influences.responses} if influences else dict[str, ResponseSensitivity]()
    responses = tuple(
        replace(
            analyse_response(
                r,
                drawn,
                spec,
                by_response.get(r.name),
                corners,
                CONFIDENCE,
                weighted.get(r.name, ()),
                withheld or why_no_property(r.name, drawn, spec.min_ok),
            ),
            repeatability=scatter.get(r.name),
            rounding=rounding.get(r.name),
        )
        for r in spec.responses
    )
    variables = tuple(analyse_variable(v, drawn.values[v.name], drawn.sample) for v in spec.variables)
    correlations = analyse_correlations(spec, drawn)
    ok = int(np.count_nonzero(samples.ok))
    advised = _advice(drawn, spec, responses, spreads)
    return Analysis(
        spec=spec,
        headline=headline(spec, counts, responses, fit),
        design=spec.design,
        finished=every.sample.size,
        ok=ok,
        failed=samples.sample.size - ok,
        used=int(np.count_nonzero(drawn.ok)),
        run_seconds=samples.run_seconds,
        statuses=count_statuses(every),
        trust=(
            *trust_checks(spec, samples, responses, variables, correlations, CONFIDENCE, fit),
            *(() if spec.measured else (repeatable(responses, repeats),)),
            *rare_checks(rare),
        ),
        responses=responses,
        rare=rare,
        product=product_yield(drawn, spec, CONFIDENCE, every.sample.size - samples.sample.size),
        assembly=fit,
        variables=variables,
        correlations=correlations,
        response_correlations=response_correlations(drawn, spec, CONFIDENCE),
        never_critical=influences.never_critical() if influences else (),
        advice=advised.growth,
        kept=advised.kept,
        kept_at=advised.kept_at,
        shortfalls=advised.shortfalls,
        advice_note=advised.note,
        failures=list_failures(spec, samples),
        failed_against_ok=failed_against_ok(every, spec.variables),
        comparison=None if other is None else compare(drawn, spec, *other, CONFIDENCE),
        confidence=CONFIDENCE,
    )


def compare_rows(
    rows: "Rows", spec: ReportSpec, other_rows: "Rows", other_spec: ReportSpec, confidence: float = CONFIDENCE
) -> Comparison:
    """Return only the comparison that `analyse` makes; ReportError if there is nothing to compare."""
    corners = next((each.campaign for each in (spec, other_spec) if each.corners), None)
    if corners is not None:
        raise ReportError(f"the samples of {corners} are corners, which do not represent production; compare others")
    return compare(*_drawn(rows, spec), *_drawn(other_rows, other_spec), confidence)


def _rare(
    samples: Samples, spec: ReportSpec, decided: Sequence[Decision]
) -> tuple[RareRejects | None, dict[str, tuple[Estimate, ...]]]:
    """Return the rare rejects of an importance campaign, or of the weighted runs that decide, and their estimates."""
    if not decided:
        own = rare_rejects(samples, spec, CONFIDENCE)
        return own, rare_estimates(own)
    found: list[RareRejects] = []
    estimates: dict[str, tuple[Estimate, ...]] = {}
    for each in decided:
        of_each = each.spec
        if found:  # later runs are for these alone
            of_each = replace(of_each, responses=tuple(r for r in of_each.responses if r.name in each.responses))
        aimed, _ = leveled_samples(read_samples(each.rows, of_each), of_each)
        rare = rare_rejects(aimed, _without_boundaries(of_each, aimed), CONFIDENCE)
        if rare is not None:
            new = decisive(estimates, rare_estimates(rare, each.responses))
            found += [rare] if new else []
            estimates |= new
    return (replace(found[0], later=tuple(found[1:])) if found else None), estimates


def _drawn(rows: "Rows", spec: ReportSpec) -> tuple[Samples, ReportSpec]:
    """Return the samples that a campaign drew from its distributions, and its spec."""
    samples, _ = leveled_samples(read_samples(rows, spec), spec)
    return independent_draws(samples, spec), spec


def _without_boundaries(spec: ReportSpec, samples: Samples) -> ReportSpec:
    """Return the spec without the limits that no value can pass; one that a value passes stays a limit."""
    responses = []
    for r in spec.responses:
        values = samples.values[r.name]
        if r.boundary == "lower" and r.lsl is not None and not np.any(values < r.lsl):
            r = replace(r, lsl=None)
        elif r.boundary == "upper" and r.usl is not None and not np.any(values > r.usl):
            r = replace(r, usl=None)
        responses.append(r)
    return replace(spec, responses=tuple(responses))


def _sensitivity(samples: Samples, spec: ReportSpec, known: Mapping[str, Known]) -> Sensitivity | None:
    """Return how the variables influence the responses; None without variables, responses or ok samples."""
    if not spec.variables or not spec.responses or not np.any(samples.ok):
        return None
    return sensitivity(
        samples.of_ok.only(v.name for v in spec.variables),
        samples.of_ok.only(r.name for r in spec.responses),
        {r.name: (r.lsl, r.usl) for r in spec.responses},
        samples.sample[samples.ok],
        CONFIDENCE,
        known,
        spec.correlations if spec.design.production else None,
        None if samples.lots is None else samples.lots[samples.ok],
    )


def _advice(
    samples: Samples, spec: ReportSpec, responses: tuple[ResponseAnalysis, ...], spreads: OtherSpreads | None
) -> ToleranceAdvice:
    """Return which spreads must shrink for responses below their required index, and which may grow for the others."""
    if not spec.design.production:
        return ToleranceAdvice(note="The samples do not represent production, so they give no advice on tolerances.")
    if spreads is None:
        return ToleranceAdvice(note="No advice: the distributions of the variables are not known.")
    columns = {v.name: samples.values[v.name] for v in spec.variables}
    varied = [v.name for v in spec.variables if v.std > 0]
    limits = {r.spec.name: (r.spec.lsl, r.spec.usl) for r in responses if (r.spec.lsl, r.spec.usl) != (None, None)}
    # A run that failed has no values: usually their columns need no copy.
    without = not any(np.isfinite(samples.values[name][~samples.ok]).any() for name in limits)
    values = {name: samples.values[name] for name in limits}
    if not without:
        values = {name: np.where(samples.ok, column, np.nan) for name, column in values.items()}
    emulation = None
    if spreads.drawn is not None and samples.lots is None:  # lots share a shift: few, however many are emulated
        n = samples.sample.size
        rows = np.arange(n) if n <= ADVISED_ROWS else random_rows(n)[:ADVISED_ROWS]
        inputs = {name: columns[name][rows] for name in varied}
        emulation = EmulatedTolerances(inputs, {name: y[rows] for name, y in values.items()}, limits, spreads.drawn)
    return tolerance_advice(
        AdvisedSamples(values, limits, varied, samples.lots, 1 - spec.min_ok, emulation),
        {
            r.spec.name: DecidingIndex(r.capability.cpk, r.index, r.spec.requirement)
            for r in responses
            if r.spec.name in limits
        },
        lambda factors, rows: spreads.change(factors, {name: x[rows] for name, x in columns.items()}),
        CONFIDENCE,
    )


def headline(
    spec: ReportSpec, counts: Mapping[str, int], responses: Sequence[ResponseAnalysis], fit: AssemblyShare | None = None
) -> str:
    """Return the outcome in a sentence or two; `counts` are the finished samples by status that can be assembled.

    If those that cannot, judged by a limit of their own (`fit`), are too many or may be, that comes first.
    """
    lead = f"{fit.words}. " if fit is not None and fit.verdict in ("open", "exceeded") else ""
    return lead + _outcome(spec, counts, responses)


def _outcome(spec: ReportSpec, counts: Mapping[str, int], responses: Sequence[ResponseAnalysis]) -> str:
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


def _without_verdict(spec: ReportSpec, limited: Sequence[ResponseAnalysis]) -> str:
    """Return the outcome without verdicts: the worst case, if the samples are corners."""
    if not limited:
        return "No response has limits, so there is nothing to judge."
    corners = [r.worst for r in limited if r.worst is not None]
    if not spec.corners or not corners:
        return "The samples do not represent production, so there is no verdict on capability."
    kept = sum(bool(worst.within) for worst in corners)
    return f"Worst case: {kept} of {len(corners)} responses with limits stay within them at every corner."


def _by_verdict(limited: Sequence[ResponseAnalysis]) -> str:
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
