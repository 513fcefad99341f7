"""The analysis of a campaign as frozen data; every file of the report renders this one model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from reporting.arrays import Array
from reporting.assembly import AssemblyShare, assembled, assembly_share
from reporting.capability.verdict import CAPABLE, IndexEstimate
from reporting.comparison import Comparison, compare
from reporting.errors import ReportError
from reporting.failed_samples import FailedAgainstOk, failed_against_ok
from reporting.headline import headline
from reporting.inputs import CorrelationAnalysis, VariableAnalysis, analyse_correlations, analyse_variable
from reporting.product_yield import ProductYield, product_yield
from reporting.rare.rare_rejects import RareRejects, decisive, rare_estimates, rare_rejects
from reporting.response import ResponseAnalysis, analyse_response
from reporting.response_correlations import ResponseCorrelation, response_correlations
from reporting.rounding import leveled_samples
from reporting.samples import Repeats, Samples, read_samples
from reporting.sensitivity.influence import ResponseSensitivity, Sensitivity
from reporting.sensitivity.repeatability import repeatabilities
from reporting.sensitivity.summary import sensitivity
from reporting.sensitivity.total_order import independent_draws, total_order
from reporting.sensitivity.unexplained import Known
from reporting.spec import Design, ReportSpec, ResponseSpec
from reporting.statuses import (
    FailedSample,
    StatusCount,
    count_statuses,
    counts_by_status,
    list_failures,
    why_no_property,
    why_no_verdict,
)
from reporting.tolerance.advice import Advice, AdvisedSamples, Shortfall, ToleranceAdvice, tolerance_advice
from reporting.tolerance.reweighting import Change
from reporting.trust.card import trust_checks
from reporting.trust.checks import Check
from reporting.trust.evidence import rare_checks
from reporting.trust.repeated_runs import repeatable

if TYPE_CHECKING:
    from reporting.samples import Rows

CONFIDENCE = 0.95
_WORSE = ("marginal", "not capable")  # verdicts below the one of a Cpk at the target

Rescale = Callable[[Mapping[str, float], Mapping[str, Array]], Change]


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
    advice: tuple[Advice, ...]  # how much each spread may grow while the responses `kept` keep Cpk 1.33; may be empty
    kept: tuple[str, ...]  # responses that have Cpk 1.33 now
    shortfalls: tuple[Shortfall, ...]  # responses with a lower Cpk, the worst first, and what must shrink for each
    advice_note: str  # why there is no advice; empty if there is
    failures: tuple[FailedSample, ...]  # the first failed samples
    failed_against_ok: tuple[FailedAgainstOk, ...]  # what separates them, by variable; empty without failed or ok ones
    comparison: Comparison | None  # with another campaign
    confidence: float  # of all intervals


def analyse(
    samples: Samples,
    spec: ReportSpec,
    rescale: Rescale | None = None,
    against: "tuple[Rows, ReportSpec] | None" = None,
    repeats: Repeats | None = None,
    decided: Sequence[Decision] = (),
) -> Analysis:
    """Return the analysis of a finished or running campaign; raise ReportError if rows or limits are wrong.

    `rescale` (factors by variable, columns of all variables) gives the change of the density at each sample when the
    standard deviations of some variables are multiplied by factors. Without it there is no tolerance advice. `against`
    is another campaign to compare with. A worst-case campaign is not compared: its worst case is shown beside the
    statistics of this one. `repeats` are samples that were simulated a second time with half the step. `decided` are
    weighted runs that decide some responses; of those that name a response, the last that give an interval decide it.
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
    advised = _advice(drawn, spec, responses, rescale)
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
    """Return only the comparison that `analyse` makes with another campaign.

    ReportError: the rows do not fit their spec, the campaigns have no response in common, or the samples of one are
    corners.
    """
    corners = next((each.campaign for each in (spec, other_spec) if each.corners), None)
    if corners is not None:
        raise ReportError(f"the samples of {corners} are corners, which do not represent production; compare others")
    return compare(*_drawn(rows, spec), *_drawn(other_rows, other_spec), confidence)


def _rare(
    samples: Samples, spec: ReportSpec, decided: Sequence[Decision]
) -> tuple[RareRejects | None, dict[str, tuple[IndexEstimate, ...]]]:
    """Return the rare rejects of an importance campaign, or of the weighted runs that decide, and their estimates."""
    if not decided:
        own = rare_rejects(samples, spec, CONFIDENCE)
        return own, rare_estimates(own)
    found: list[RareRejects] = []
    estimates: dict[str, tuple[IndexEstimate, ...]] = {}
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
    return replace(spec, responses=tuple(_without_boundary(r, samples.values[r.name]) for r in spec.responses))


def _without_boundary(spec: ResponseSpec, values: Array) -> ResponseSpec:
    if spec.boundary == "lower" and spec.lsl is not None and not np.any(values < spec.lsl):
        return replace(spec, lsl=None)
    if spec.boundary == "upper" and spec.usl is not None and not np.any(values > spec.usl):
        return replace(spec, usl=None)
    return spec


def _sensitivity(samples: Samples, spec: ReportSpec, known: Mapping[str, Known]) -> Sensitivity | None:
    """Return how the variables influence the responses; None without variables, responses or ok samples."""
    if not spec.variables or not spec.responses or not np.any(samples.ok):
        return None
    limits = {r.name: (r.lsl, r.usl) for r in spec.responses}
    return sensitivity(
        {v.name: samples.values[v.name][samples.ok] for v in spec.variables},
        {r.name: samples.values[r.name][samples.ok] for r in spec.responses},
        limits,
        samples.sample[samples.ok],
        CONFIDENCE,
        known,
        spec.correlations if spec.design.production else None,
        None if samples.lots is None else samples.lots[samples.ok],
    )


def _advice(
    samples: Samples, spec: ReportSpec, responses: tuple[ResponseAnalysis, ...], rescale: Rescale | None
) -> ToleranceAdvice:
    """Return which spreads must shrink for responses below Cpk 1.33, and which may grow for the others."""
    if not spec.design.production:
        return ToleranceAdvice(note="The samples do not represent production, so they give no advice on tolerances.")
    if rescale is None:
        return ToleranceAdvice(note="No advice: the distributions of the variables are not known.")
    columns = {v.name: samples.values[v.name] for v in spec.variables}
    limited = [r for r in responses if r.spec.lsl is not None or r.spec.usl is not None]
    found = tolerance_advice(
        AdvisedSamples(
            {r.spec.name: np.where(samples.ok, samples.values[r.spec.name], np.nan) for r in limited},
            {r.spec.name: (r.spec.lsl, r.spec.usl) for r in limited},
            columns,
            [v.name for v in spec.variables if v.std > 0],
            samples.lots,
            1 - spec.min_ok,
        ),
        {r.spec.name: r.capability.cpk for r in limited},
        CAPABLE,
        lambda factors, rows: rescale(factors, {name: x[rows] for name, x in columns.items()}),
        CONFIDENCE,
    )
    doubtful = [r.spec.name for r in limited if r.spec.name in found.kept and r.verdict.word in _WORSE]
    if not doubtful or not found.growth:
        return found
    note = "Cpk reaches its target, but the verdict is worse. The advice considers Cpk alone: do not use it for them."
    return replace(found, note=f"{', '.join(doubtful)}: {note}")
