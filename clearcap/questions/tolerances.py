"""Advice without new runs: how much each tolerance may grow, and which set of tolerances is cheapest."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from campaign.errors import CampaignError
from campaign.inputs.distributions import Distribution
from campaign.plan import Plan
from campaign.samples import Limits, SampleColumns, independent_samples, limits_of, lots_of
from campaign.store import Store
from clearcap.questions.cost_file import Cost, Costs
from clearcap.questions.spreads import Spreads
from clearcap.questions.whatif import check_drawn
from engine.arrays import Array
from reporting import ReportError, capability
from reporting.capability.verdict import CAPABLE
from reporting.sensitivity.summary import sensitivity
from reporting.tolerance.advice import AdvisedSamples, ToleranceAdvice, tolerance_advice
from reporting.tolerance.allocation import Allocation, CostedVariable, Requirement, allocate
from reporting.tolerance.reweighting import Change


def advice_of(store: Store, plan: Plan) -> ToleranceAdvice:
    """Return `advice_from` for the samples in the store."""
    check_drawn(plan.spec)
    return advice_from(plan, independent_samples(store, plan))


def advice_from(plan: Plan, columns: SampleColumns) -> ToleranceAdvice:
    """Return which spreads must shrink for responses below Cpk 1.33, and which may grow for the others.

    Raises SpecError if the samples are not drawn from distributions, CampaignError if no response has limits and
    values.
    """
    check_drawn(plan.spec)
    samples, limits, lots = columns.values, _given_limits(plan), lots_of(plan, columns.number)
    variables = {name: samples[name] for name in plan.spec.variables}
    spreads = Spreads(plan.spec, plan.mechanism)

    def rescale(factors: Mapping[str, float], rows: NDArray[np.intp]) -> Change:
        return spreads.change(factors, _variables(plan, samples, rows))

    with _advice_errors(plan):
        cpks = {
            name: capability(samples[name], lsl=pair[0], usl=pair[1], ordered=False).cpk
            for name, pair in limits.items()
        }
        if all(cpk is None for cpk in cpks.values()):
            raise ReportError("no response has limits and values that vary; give limits to at least one")
        responses, most_failed = {name: samples[name] for name in limits}, 1 - plan.spec.failures.min_ok
        return tolerance_advice(
            AdvisedSamples(responses, limits, variables, _varied(plan), lots, most_failed), cpks, CAPABLE, rescale
        )


def cheapest_tolerances(store: Store, plan: Plan, costs: Costs) -> Allocation:
    """Return `cheapest_from` for the samples in the store."""
    check_drawn(plan.spec)
    return cheapest_from(plan, independent_samples(store, plan), costs)


def cheapest_from(plan: Plan, columns: SampleColumns, costs: Costs) -> Allocation:
    """Return the cheapest standard deviations with which every response meets its target.

    Raises SpecError if the samples are not drawn from distributions, CampaignError if no response has limits and values
    or the costs are impossible.
    """
    check_drawn(plan.spec)
    samples, limits = columns.values, _given_limits(plan)
    values = {name: samples[name][np.isfinite(samples[name])] for name in limits}
    spreads = Spreads(plan.spec, plan.mechanism)
    variables = [_costed(name, plan.spec.variables[name], cost, spreads) for name, cost in costs.variables.items()]
    free = {variable.variable for variable in variables if not variable.locked}
    correlated = any(free & {a, b} for a, b, rank in plan.spec.correlations or () if rank)

    def scale_all(factors: Mapping[str, float], rows: NDArray[np.intp]) -> Change:
        return spreads.change(factors, _variables(plan, samples, rows))

    with _advice_errors(plan):
        shares = _shares(plan, samples, limits)
        requirements = [
            Requirement(name, float(x.mean()), float(x.std(ddof=1)), *limits[name], costs.target, _parts(shares[name]))
            for name, x in values.items()
            if x.size > 1
        ]
        responses = {requirement.response: samples[requirement.response] for requirement in requirements}
        return allocate(variables, requirements, responses, scale_all, correlated)


@contextmanager
def _advice_errors(plan: Plan) -> Iterator[None]:
    """Add the name of the campaign to errors of `reporting`."""
    try:
        yield
    except ReportError as error:
        raise CampaignError(f"advice of {plan.campaign_id}: {error}") from error


def _given_limits(plan: Plan) -> Limits:
    """Return the limits of the responses that have any."""
    return {name: pair for name, pair in limits_of(plan).items() if pair != (None, None)}


def _variables(plan: Plan, samples: Mapping[str, Array], rows: NDArray[np.intp]) -> dict[str, Array]:
    """Return the values of the variables at some of the samples."""
    return {name: samples[name][rows] for name in plan.spec.variables}


def advice_document(plan: Plan, store_url: str, advised: ToleranceAdvice) -> dict[str, Any]:
    """Return the advice as data, as ``clearcap advise --json`` and the web service write it."""
    return {
        "campaign": plan.campaign_id,
        "store": store_url,
        "advice": [asdict(each) for each in advised.growth],
        "kept": advised.kept,
        "below": {each.response: [asdict(a) for a in each.alone] for each in advised.shortfalls},
        "together": {each.response: each.together and asdict(each.together) for each in advised.shortfalls},
        "remedies": {each.response: each.text for each in advised.shortfalls},
        "note": advised.note,
    }


def allocation_document(plan: Plan, store_url: str, proposal: Allocation) -> dict[str, Any]:
    """Return the cheapest tolerances as ``clearcap advise --cost FILE --json`` and the web service write them."""
    return {"campaign": plan.campaign_id, "store": store_url, "allocation": asdict(proposal)}


def _shares(plan: Plan, samples: Mapping[str, Array], limits: Limits) -> dict[str, dict[str, float]]:
    """Return the share of each response's variance by variable."""
    summary = sensitivity(
        {name: samples[name] for name in plan.spec.variables}, {name: samples[name] for name in limits}, limits
    )
    return {r.response: {i.variable: i.first_order or 0.0 for i in r.influences} for r in summary.responses}


def _parts(shares: Mapping[str, float]) -> dict[str, float]:
    """Return estimated shares as parts of one variance: none is below 0, and the sum is at most 1."""
    positive = {name: max(share, 0.0) for name, share in shares.items()}
    total = max(sum(positive.values()), 1.0)
    return {name: share / total for name, share in positive.items()}


def _varied(plan: Plan) -> list[str]:
    """Return the variables that vary."""
    return [name for name, variable in plan.spec.variables.items() if variable.moments()[1] > 0]


def _costed(name: str, distribution: Distribution, cost: Cost, spreads: Spreads) -> CostedVariable:
    """Return the range of standard deviations with which a variable can be made, and its cost law."""
    std = distribution.moments()[1]
    lower, upper = cost.lower or 0.1 * std, cost.upper or 10 * std
    largest = spreads.of_variable(name, upper / std).factor * std if upper > std else upper
    return CostedVariable(name, std, cost.law(), lower, max(min(upper, largest), lower), cost.locked)
