"""Questions to a campaign's samples without new runs: what if, how far, at what cost."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from campaign.errors import CampaignError, SpecError
from campaign.inputs.distributions import Array, Number, Spread
from campaign.inputs.distributions.base import Table
from campaign.inputs.sampling import sampler_named
from campaign.plan import Plan
from campaign.reports.changed_distributions import change, changed, check_drawn, widened
from campaign.spec.campaign_file import Response
from campaign.spec.messages import fault
from campaign.store import Store
from reporting import ReportError, capability
from reporting.capability.verdict import CAPABLE
from reporting.sensitivity.summary import sensitivity
from reporting.tolerance.advice import Advice, advise
from reporting.tolerance.allocation import Allocation, CostedVariable, Requirement, allocate
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import WhatIf, what_if_all

Limits = dict[str, tuple[float | None, float | None]]


class Cost(Table):
    """What making one variable to a standard deviation costs: ``fixed + cost / std``.

    Attributes
    ----------
    fixed : float
        In money.
    cost : float
        In money times the variable's unit.
    lower, upper : float or None
        Between which the standard deviation may be chosen; a tenth and ten times the present one if not given.
    locked : bool
        It stays as it is.
    """

    fixed: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.0
    cost: Spread
    lower: Spread | None = None
    upper: Spread | None = None
    locked: bool = False


class Costs(Table):
    """A cost file.

    Attributes
    ----------
    target : float
        Cpk that every response with limits must have.
    variables : dict of str to Cost
        By variable; those that are not named stay as they are.
    """

    target: Annotated[Number, Field(gt=0.0)] = CAPABLE
    variables: Annotated[dict[str, Cost], Field(min_length=1)]


def read_costs(path: Path, plan: Plan) -> Costs:
    """Read a cost file.

    Raises
    ------
    SpecError
        With all faults of the file.
    """
    try:
        found = Costs.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise SpecError(f"cost file {path}: {error.strerror}; name a file that can be read") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SpecError(f"cost file {path}: no TOML: {error}; correct it") from error
    except ValidationError as error:
        lines = [fault(map(str, e["loc"]), e["input"], e["msg"]) for e in error.errors(include_url=False)]
        raise SpecError("\n  ".join([f"cost file {path}:", *lines])) from error
    unknown = [name for name in found.variables if name not in plan.spec.variables]
    if unknown:
        known = ", ".join(plan.spec.variables)
        raise SpecError(f"cost file {path}: variables.{unknown[0]}: no variable of the campaign; allowed: {known}")
    return found


def what_if(store: Store, plan: Plan, settings: list[str]) -> dict[str, WhatIf]:
    """Return every response under changed distributions.

    Parameters
    ----------
    store : Store
        Where the campaign is.
    plan : Plan
        The campaign.
    settings : list of str
        See `campaign.reports.changed_distributions.changed`.

    Raises
    ------
    SpecError
        If a setting cannot be.
    CampaignError
        If there are no samples to ask.
    """
    check_drawn(plan.spec)
    new = changed(plan.spec, settings)
    columns = _columns(store, plan)
    responses = {name: columns[name] for name in plan.mechanism.responses}
    try:
        return what_if_all(responses, change(plan.spec, new, columns), limits_of(plan))
    except ReportError as error:
        raise CampaignError(f"what if of {plan.campaign_id}: {error}") from error


def tolerance_advice(store: Store, plan: Plan) -> tuple[tuple[Advice, ...], dict[str, tuple[Advice, ...]]]:
    """Return how far the spread of each variable may go, alone, for every Cpk to be 1.33.

    Returns
    -------
    tuple of Advice
        How far each may grow with every response that is at 1.33 now staying there; none if no response is.
    dict of str to tuple of Advice
        By response that is below: how far each must shrink to lift it there.

    Raises
    ------
    SpecError
        If the samples are drawn from no distributions.
    CampaignError
        If no response has limits and values.
    """
    check_drawn(plan.spec)
    columns = _columns(store, plan)
    limits = {name: pair for name, pair in limits_of(plan).items() if pair != (None, None)}

    def wider(variable: str, factor: float, rows: NDArray[np.intp]) -> Change:
        return widened(plan.spec, {variable: factor}, {name: columns[name][rows] for name in plan.spec.variables})

    def asked(names: list[str]) -> tuple[Advice, ...]:
        responses = {name: columns[name] for name in names}
        return advise(responses, limits, dict.fromkeys(names, CAPABLE), shares, _varied(plan), wider)

    try:
        shares = _shares(plan, columns, limits)
        cpks = {name: capability(columns[name], lsl=pair[0], usl=pair[1]).cpk for name, pair in limits.items()}
        able = [name for name, cpk in cpks.items() if cpk is not None and cpk >= CAPABLE]
        below = [name for name, cpk in cpks.items() if cpk is not None and cpk < CAPABLE]
        if not cpks or not able + below:
            raise ReportError("no response has limits and values that vary; give limits to at least one")
        return asked(able) if able else (), {name: asked([name]) for name in below}
    except ReportError as error:
        raise CampaignError(f"advice of {plan.campaign_id}: {error}") from error


def tolerances(store: Store, plan: Plan, costs: Costs) -> Allocation:
    """Return the cheapest standard deviations with which every response keeps its target.

    Raises
    ------
    SpecError
        If the samples are drawn from no distributions.
    CampaignError
        If no response has limits and values, or the costs are impossible.
    """
    check_drawn(plan.spec)
    columns = _columns(store, plan)
    limits = {name: pair for name, pair in limits_of(plan).items() if pair != (None, None)}
    known = {name: columns[name][np.isfinite(columns[name])] for name in limits}
    joints = [_joint(name, plan.spec.variables[name].moments()[1], cost) for name, cost in costs.variables.items()]

    def rescale(factors: Mapping[str, float], rows: NDArray[np.intp]) -> Change:
        return widened(plan.spec, factors, {name: columns[name][rows] for name in plan.spec.variables})

    try:
        shares = _shares(plan, columns, limits)
        wanted = [
            Requirement(name, float(x.mean()), float(x.std(ddof=1)), *limits[name], costs.target, shares[name])
            for name, x in known.items()
            if x.size > 1
        ]
        return allocate(joints, wanted, {r.response: columns[r.response] for r in wanted}, rescale)
    except ReportError as error:
        raise CampaignError(f"advice of {plan.campaign_id}: {error}") from error


def limits_of(plan: Plan) -> Limits:
    """Return lower and upper limit of every response of the mechanism."""
    return {name: plan.spec.responses.get(name, Response()).limits()[:2] for name in plan.mechanism.responses}


def _columns(store: Store, plan: Plan) -> dict[str, Array]:
    """Return variables and responses of all rows that are draws by themselves, NaN where there is no value."""
    names = [*plan.spec.variables, *plan.mechanism.responses]
    pieces: dict[str, list[Array]] = {name: [] for name in names}
    for table in store.stream(plan, ["sample", *names]):
        rows = sampler_named(plan.spec.sampler).independent(plan.spec, table["sample"].to_numpy())
        for name in names:
            pieces[name].append(table[name].to_numpy()[rows])
    if not pieces[names[0]]:
        raise CampaignError(f"{plan.campaign_id}: no sample is done yet; wait for the first, or run it")
    return {name: np.concatenate(pieces.pop(name)) for name in names}


def _shares(plan: Plan, columns: Mapping[str, Array], limits: Limits) -> dict[str, dict[str, float]]:
    """Return the share of each response's variance by variable."""
    found = sensitivity(
        {name: columns[name] for name in plan.spec.variables}, {name: columns[name] for name in limits}, limits
    )
    return {r.response: {i.variable: i.first_order or 0.0 for i in r.influences} for r in found.responses}


def _varied(plan: Plan) -> list[str]:
    """Return the variables that vary."""
    return [name for name, variable in plan.spec.variables.items() if variable.moments()[1] > 0]


def _joint(name: str, std: float, cost: Cost) -> CostedVariable:
    """Return what may be done to one variable."""
    lower, upper = cost.lower or 0.1 * std, cost.upper or 10 * std
    return CostedVariable(name, std, cost.fixed, cost.cost, lower, upper, cost.locked)
