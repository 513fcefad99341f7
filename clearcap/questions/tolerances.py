"""Advice without new runs: how much each tolerance may grow, and which set is cheapest for a cost file."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from campaign.errors import CampaignError, SpecError
from campaign.inputs.distributions import Distribution
from campaign.plan import Plan
from campaign.samples import Limits, SampleColumns, independent_samples, limits_of, lots_of
from campaign.spec.faults import structure_faults
from campaign.store import Store
from clearcap.questions.spreads import Spreads
from clearcap.questions.whatif import check_drawn
from engine.arrays import Array
from engine.mechanism.base import PositiveNumber, TableModel
from engine.platform.toml_file import UnfitToml, read_toml
from reporting import ReportError, capability
from reporting.capability.verdict import CAPABLE
from reporting.sensitivity.summary import sensitivity
from reporting.tolerance.advice import AdvisedSamples, ToleranceAdvice, tolerance_advice
from reporting.tolerance.allocation import Allocation, CostedVariable, Requirement, allocate
from reporting.tolerance.cost_laws import CostLaw, ExponentialLaw, PowerLaw, Process, ProcessTable
from reporting.tolerance.reweighting import Change


class ProcessCost(TableModel, strict=True):
    """One process that makes a variable."""

    std: PositiveNumber = Field(description="Standard deviation that it reaches, in the variable's unit, above 0.")
    cost: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = Field(description="Cost in money, at least 0.")
    name: Annotated[str, Field(max_length=60)] = Field(default="", description="Name of the process.")


class Cost(TableModel, strict=True):
    """The cost of a standard deviation of one variable.

    ``fixed + cost / std``; with `power`, ``fixed + cost / std^power``; with `scale`,
    ``fixed + cost exp(-std / scale)``; with `processes`, one of them.
    """

    fixed: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = Field(
        default=0.0, description="Cost that does not depend on the standard deviation, in money, at least 0."
    )
    cost: PositiveNumber | None = Field(
        default=None,
        description="Cost above 0, in money times the variable's unit to the power; with scale, in money.",
    )
    power: PositiveNumber | None = Field(default=None, description="Power of std in fixed + cost / std^power, above 0.")
    scale: PositiveNumber | None = Field(
        default=None, description="Scale of fixed + cost exp(-std / scale), above 0, in the variable's unit."
    )
    processes: Annotated[list[ProcessCost], Field(min_length=1, max_length=100)] | None = Field(
        default=None, description="Processes of which one is chosen: a list of {std, cost, name}."
    )
    lower: PositiveNumber | None = Field(
        default=None,
        description="Least standard deviation to choose, in the variable's unit; a tenth of the present one if absent.",
    )
    upper: PositiveNumber | None = Field(
        default=None,
        description="Largest standard deviation to choose, in the variable's unit; ten times the present if absent.",
    )
    locked: bool = Field(default=False, description="Whether the variable keeps its present standard deviation.")

    @model_validator(mode="after")
    def _is_one_law(self) -> Self:
        """Raise ValueError for keys of several laws, and for a table without a law."""
        if self.processes is not None:
            others = [key for key in ("fixed", "cost", "power", "scale") if key in self.model_fields_set]
            if others:
                raise ValueError(f"has {others[0]} beside processes, which have costs of their own; remove one of them")
        elif self.cost is None:
            raise ValueError("has no cost; add cost, or processes")
        elif self.power is not None and self.scale is not None:
            raise ValueError("has power and scale, which belong to different laws; remove one of them")
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise ValueError(f"lower = {self.lower:g} is above upper = {self.upper:g}; exchange or correct them")
        return self

    def law(self) -> CostLaw:
        """Return the cost law in the form that `reporting` uses."""
        if self.processes is not None:
            return ProcessTable(tuple(Process(p.std, p.cost, p.name) for p in self.processes))
        assert self.cost is not None
        if self.scale is not None:
            return ExponentialLaw(self.fixed, self.cost, self.scale)
        return PowerLaw(self.fixed, self.cost, 1.0 if self.power is None else self.power)


class Costs(TableModel, strict=True):
    """A cost file."""

    target: PositiveNumber = Field(
        default=CAPABLE, description="Cpk that every response with limits must have, above 0."
    )
    variables: Annotated[dict[str, Cost], Field(min_length=1)] = Field(
        description="Cost of each variable by its name; variables that are not named stay as they are."
    )


def read_costs(path: Path, plan: Plan) -> Costs:
    """Read a cost file for the variables of a campaign; raise SpecError with all its faults."""
    try:
        tables = read_toml(path)
    except OSError as error:
        raise SpecError(f"cost file {path}: {error.strerror or error}; name a file that can be read") from error
    except UnfitToml as error:
        raise SpecError(f"cost file {path}: {error}") from error
    return costs_of(tables, plan, f"cost file {path}:")


def costs_of(tables: Mapping[str, Any], plan: Plan, heading: str) -> Costs:
    """Return the costs in the tables of a cost file; raise SpecError with all faults, which begin with `heading`."""
    try:
        costs = Costs.model_validate(tables)
    except ValidationError as error:
        faults = structure_faults(error, Costs)
        raise SpecError("\n  ".join([heading, *map(str, faults)]), faults) from error
    unknown = [name for name in costs.variables if name not in plan.spec.variables]
    if unknown:
        allowed = ", ".join(plan.spec.variables)
        raise SpecError(f"{heading} variables.{unknown[0]}: the campaign has no such variable; allowed: {allowed}")
    return costs


def advice_of(store: Store, plan: Plan) -> ToleranceAdvice:
    """Return `advice_from` for the samples in the store."""
    check_drawn(plan.spec)
    return advice_from(plan, independent_samples(store, plan))


def advice_from(plan: Plan, columns: SampleColumns) -> ToleranceAdvice:
    """Return which spreads must shrink for responses below Cpk 1.33, and which may grow for the others."""
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
    """Return the cheapest standard deviations with which every response meets its target."""
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
        found = allocate(variables, requirements, responses, scale_all, correlated)
        return replace(found, written={name: spreads.written(name, factor) for name, factor in found.factors.items()})


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
