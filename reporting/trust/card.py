"""The lines of the trust card, in reading order.

They check that the campaign is complete, that the simulation meets its bounds in every sample, and that the
statistics support the verdicts.
"""

from reporting.assembly import AssemblyShare
from reporting.format_numbers import grouped
from reporting.inputs import CorrelationAnalysis, VariableAnalysis
from reporting.response import ResponseAnalysis
from reporting.samples import Samples
from reporting.spec import INDEPENDENT, ReportSpec
from reporting.trust.checks import (
    PENETRATION_BAR,
    RESIDUAL_BAR,
    Check,
    accidents,
    assembles,
    complete,
    drawn_as_requested,
    energy,
    failures,
    largest,
    settled,
)
from reporting.trust.evidence import (
    converged,
    enough_samples,
    failures_as_rejects,
    gauges,
    limits_in_place,
    many_statements,
    missing_values,
    production_lots,
    row_order,
    stability,
    verdicts_hold,
)
from reporting.trust.normal_shape import normal_shape

_ORDER = {True: "in the order in which they were made", False: "in an order that means nothing"}


def trust_checks(
    spec: ReportSpec,
    samples: Samples,
    responses: tuple[ResponseAnalysis, ...],
    variables: tuple[VariableAnalysis, ...],
    correlations: tuple[CorrelationAnalysis, ...],
    confidence: float,
    fit: AssemblyShare | None = None,
) -> tuple[Check, ...]:
    """Return the lines of the trust card, in reading order.

    ``samples`` are those that can be assembled, where a limit judges the others (``fit``).
    """
    unit, design = samples.penetration_unit, spec.design
    if spec.measured:
        return _checks_of_parts(spec, samples, responses, confidence)
    return (
        Check("Sampling", "info" if design.production else "attention", _sampling(spec, samples)),
        *production_lots(responses),
        complete(spec.requested, samples.sample.size if fit is None else fit.n),
        enough_samples(responses, production=design.production),
        verdicts_hold(responses),
        *([many_statements(responses, confidence)] if design.production else []),
        converged(responses, production=design.production),
        *(row_order(responses) if design.production else ()),
        *([Check("Stopping rule", "info", spec.stop)] if spec.stop else []),
        *([] if fit is None else [assembles(fit)]),
        failures(samples, spec.min_ok),
        failures_as_rejects(responses, samples),
        missing_values(responses),
        *limits_in_place(responses),
        normal_shape(responses),
        largest("Friction residual", samples, samples.max_residual, "", RESIDUAL_BAR),
        largest("Penetration", samples, samples.max_penetration, unit, PENETRATION_BAR.get(unit)),
        *energy(samples),
        settled(samples),
        *accidents(samples),
        drawn_as_requested(variables, correlations, production=design.production),
    )


def _checks_of_parts(
    spec: ReportSpec, samples: Samples, responses: tuple[ResponseAnalysis, ...], confidence: float
) -> tuple[Check, ...]:
    """Return the lines on measured parts; stability comes first, because no index predicts an unstable process."""
    parts = f"{grouped(samples.sample.size)} measured parts, {_ORDER[spec.ordered]}."
    return (
        stability(responses, ordered=spec.ordered),
        Check("Parts", "info", parts),
        *gauges(responses),
        *production_lots(responses),
        enough_samples(responses, production=True),
        verdicts_hold(responses),
        many_statements(responses, confidence),
        converged(responses, production=True),
        *(row_order(responses) if spec.ordered else ()),
        missing_values(responses, measured=True),
        *limits_in_place(responses),
        normal_shape(responses),
    )


def _sampling(spec: ReportSpec, samples: Samples) -> str:
    """Return the description of the samples; samples of a production lot are not independent."""
    if samples.lots is None or spec.design != INDEPENDENT:
        return spec.design.text
    return "Random samples in production lots; those of one lot are not independent of each other."
