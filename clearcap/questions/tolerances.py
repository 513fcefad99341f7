"""Advice without new runs: how much each tolerance may grow, and which set is cheapest for a cost file.

The cheapest set is found by the weights of the rows, or by an emulator of them where the weights carry no answer.

A factor multiplies the standard deviation that a variable has after the cut at its bounds. Bounds never move outwards:
a truncated normal distribution gets another ``std`` between its old bounds, and a uniform one, which fills its bounds,
cannot grow. A distribution without bounds grows until the mechanism refuses its outermost values, such as a clearance
below 0.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from math import exp, inf, isfinite, log
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from campaign.errors import CampaignError, SpecError
from campaign.inputs.distributions import Continuous, Distribution
from campaign.inputs.sampling import draw
from campaign.inputs.sampling.sampler import varied
from campaign.plan import Plan
from campaign.samples import Limits, SampleColumns, independent_samples, limits_of, lots_of
from campaign.spec.campaign_file import CampaignSpec
from campaign.spec.faults import structure_faults
from campaign.store import Store
from clearcap.questions.whatif import change_distributions, check_drawn
from engine import MechanismError, check
from engine.arrays import Array
from engine.mechanism import Mechanism
from engine.mechanism.base import PositiveNumber, TableModel
from engine.platform.toml_file import UnfitToml, parse_toml, read_toml, text_bytes
from reporting import ReportError, format_numbers
from reporting.capability.verdict import CAPABLE
from reporting.emulation.emulated_tolerances import NEW_SAMPLES, EmulatedTolerances
from reporting.sensitivity.summary import sensitivity
from reporting.tolerance.advice import ToleranceAdvice
from reporting.tolerance.allocation import Allocation, CostedVariable, Requirement, allocate
from reporting.tolerance.cost_laws import CostLaw, ExponentialLaw, PowerLaw, Process, ProcessTable
from reporting.tolerance.reweighting import Change

SAME = 1e-6  # relative difference below which two standard deviations are the same
# Steps of the search for a standard deviation, in the logarithm of the scale; one that is not found is not possible.
_FIRST_STEP, _STEP_GROWTH, _MOST_STEPS = 0.25, 1.15, 15
_BISECTIONS = 12  # between a factor that the mechanism accepts and one that it refuses
_SEARCHED = 10.0  # factors up to this are tried on the mechanism at once
_DIGITS = 7  # of a number for users to write into a file

# Parameters that a distribution may have in place of mean and std.
_SHIFTED = {"shift", "sigma_shift", "inertia"}  # the spread follows from more than the tolerance
_NATURAL = (
    *("dimension", "fit", "nominal", "tolerance", "cpk", *_SHIFTED, "inflation"),
    *("alpha", "beta", "shape", "scale", "log_mean", "log_std"),
)


@dataclass(frozen=True)
class Spread:
    """A distribution with another standard deviation."""

    law: Distribution
    factor: float  # ratio of its standard deviation to the old one
    keys: dict[str, Any] = field(default_factory=dict)  # to write into the variable's table to get it
    limit: str = ""  # why the factor is nearer to 1 than the requested one; empty if it is the requested one


class Spreads:
    """The variables of a campaign with other standard deviations; a mechanism refuses impossible values."""

    def __init__(self, spec: CampaignSpec, mechanism: Mechanism | None = None) -> None:
        self._spec, self._mechanism = spec, mechanism
        self._largest: dict[str, tuple[float, Spread]] = {}
        self._found: dict[tuple[str, float], Spread] = {}

    def of_variable(self, name: str, factor: float) -> Spread:
        """Return a variable with a factor times its standard deviation, or with the nearest possible factor."""
        if (name, factor) not in self._found:
            self._found[name, factor] = self._nearest(name, factor)
        return self._found[name, factor]

    def _nearest(self, name: str, factor: float) -> Spread:
        old = self._spec.variables[name]
        if factor <= 1:
            return with_spread(old, factor)
        asked, largest = self._largest.get(name, (0.0, Spread(old, 1.0)))
        if factor > asked and not largest.limit:
            asked, largest = self._largest[name] = max(factor, _SEARCHED), self._find_largest(name, factor)
        return largest if largest.limit and factor > largest.factor else with_spread(old, factor)

    def change(self, factors: Mapping[str, float], columns: Mapping[str, Array]) -> Change:
        """Return the effect on samples (n,) of factors on standard deviations, or of the nearest possible factors."""
        spreads = {name: self.of_variable(name, factor) for name, factor in factors.items()}
        change = change_distributions(self._spec, {name: each.law for name, each in spreads.items()}, columns)
        limited = [each for each in spreads.values() if each.limit]
        return replace(
            change,
            spread=min((each.factor for each in limited or spreads.values()), key=lambda f: abs(log(f))),
            limit="; ".join(dict.fromkeys(each.limit for each in limited)),
            settings=tuple(
                f"{name}.{key}={_shown(x)}" for name, each in spreads.items() for key, x in each.keys.items()
            ),
            written=tuple(text for name, factor in factors.items() for text in self.written(name, factor)),
        )

    def drawn(self, factors: Mapping[str, float]) -> Mapping[str, Array]:
        """Return new samples of all variables, shape (m,), with factors on standard deviations."""
        laws = {name: self.of_variable(name, factor).law for name, factor in factors.items()}
        update = {"variables": {**self._spec.variables, **laws}, "sampler": "sobol", "samples": NEW_SAMPLES}
        return draw(self._spec.model_copy(update=update), 0, NEW_SAMPLES)

    def written(self, name: str, factor: float) -> tuple[str, ...]:
        """Return what to write for a factor on one standard deviation, in the digits of a drawing."""
        spread = self.of_variable(name, factor)
        std = spread.law.moments()[1]
        return tuple(f"{name}.{key}={_as_drawn(x, std)}" for key, x in spread.keys.items())

    def _find_largest(self, name: str, factor: float) -> Spread:
        """Return a variable with the largest spread that its bounds and the mechanism allow, up to the tried factor."""
        old = self._spec.variables[name]
        ends, most = old.ends(), with_spread(old, max(factor, _SEARCHED))
        refusal = self._refusal(name, ends, most.law)
        if not refusal:
            return most
        low, high, best = 0.0, log(most.factor), Spread(old, 1.0)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            tried = with_spread(old, exp(middle))
            refused = self._refusal(name, ends, tried.law)
            low, high = (low, middle) if refused else (middle, high)
            best, refusal = (best, refused) if refused else (tried, refusal)
        return replace(best, limit=refusal)

    def _refusal(self, name: str, ends: tuple[float, float], new: Distribution) -> str:
        """Return the message about a value beyond the old ends that the mechanism refuses; empty if there is none."""
        if self._mechanism is None:
            return ""
        (low, high), (least, most) = new.ends(), ends
        for value in [x for x, is_farther in ((low, low < least), (high, high > most)) if is_farther]:
            try:
                check(self._mechanism, {self._spec.targets()[name]: value})
            except MechanismError:
                return f"more would reach {name} = {value:.3g}, which the mechanism refuses"
        return ""


def with_spread(old: Distribution, factor: float) -> Spread:
    """Return a distribution of the same kind with a factor times the standard deviation, or the nearest possible."""
    if not isinstance(old, Continuous):
        return Spread(old, 1.0, {}, "its values are separate: its spread follows from their probabilities")
    if abs(factor - 1) < SAME:
        return Spread(old, 1.0)
    law = _search(old, factor)
    reached = law.moments()[1] / old.moments()[1]
    same = abs(reached / factor - 1) < 10 * SAME
    limit = "its bounds allow no more" if factor > 1 else "its distribution allows no less"
    keys = {key: value for key, value in law.model_dump(exclude_none=True).items() if value != getattr(old, key)}
    if "batch" in keys:  # a table in the variable's table
        keys["batch.std"] = keys.pop("batch")["std"]
    return Spread(law, factor if same else reached, keys, "" if same else limit)


def _search(old: Continuous, factor: float) -> Continuous:
    """Return the distribution with a factor times the standard deviation, or the nearest one that exists.

    Steps are small, because between bounds the standard deviation may fall again while the spread before the cut grows.
    """
    from scipy.optimize import brentq, minimize_scalar  # takes 0.4 s to import

    wanted, way = factor * old.moments()[1], 1.0 if factor > 1 else -1.0

    def excess(scale: float) -> float | None:
        scaled = _scaled(old, exp(scale))
        return None if scaled is None else scaled.moments()[1] / wanted - 1.0

    passed, far, step, wall = [(0.0, 1 / factor - 1)], log(factor), _FIRST_STEP, inf
    for _ in range(_MOST_STEPS):
        found = excess(far)
        if found is None:
            wall = far
        elif abs(found) < SAME:
            return _scaled(old, exp(far)) or old
        elif found * way > 0:
            root = brentq(lambda scale: excess(scale) or 0.0, passed[-1][0], far, xtol=0.1 * SAME)
            return _scaled(old, exp(float(root))) or old
        else:
            passed.append((far, found))
        near, step = passed[-1][0], step * _STEP_GROWTH
        far = 0.5 * (near + wall) if isfinite(wall) else near + way * step
    best = max(range(len(passed)), key=lambda i: way * passed[i][1])
    scale = passed[best][0]
    if best + 1 < len(passed):
        ends = sorted((passed[max(best - 1, 0)][0], passed[best + 1][0]))
        scale = float(minimize_scalar(lambda at: -way * (excess(at) or -inf), bounds=ends, method="bounded").x)
    return _scaled(old, exp(scale)) or old


def _scaled(old: Continuous, scale: float) -> Continuous | None:
    """Return a distribution with its spread before the cut scaled; None if none exists within its bounds.

    The mean before the cut stays the same, except for an exponential distribution, whose mean determines its spread.
    """
    table = old.model_dump(exclude_none=True)
    has_moments = {"mean", "std"} <= type(old).model_fields.keys()
    if "tolerance" in table and not _SHIFTED & table.keys():  # the capability of the manufacturer stays the same
        table["tolerance"] *= scale
    elif "zone" in table:
        table |= {key: table[key] * scale for key in ("zone", "std") if key in table}
    elif table["distribution"] == "exponential":
        table = {key: x for key, x in table.items() if key not in ("mean", "std")}
        table["scale"] = old.parent().moments()[1] * scale
    elif has_moments:
        mean, std = old.parent().moments()
        table = {key: x for key, x in table.items() if key not in _NATURAL} | {"mean": mean, "std": std * scale}
    elif scale > 1:
        return None
    else:  # its ends, which determine its spread, and its mode move towards its mean
        mean = old.moments()[0]
        within = {"within": [mean + scale * (x - mean) for x in table["within"]]} if "within" in table else {}
        table |= {
            key: mean + scale * (table[key] - mean) for key in ("lower", "upper", "mode") if key in table
        } | within
    if table.get("batch"):
        table["batch"] = {**table["batch"], "std": table["batch"]["std"] * scale}
    try:
        return type(old).model_validate(table)
    except ValidationError:
        return None


def _shown(value: Any) -> str:
    return f"[{', '.join(map(_shown, value))}]" if isinstance(value, tuple | list) else f"{value:.{_DIGITS}g}"


def _as_drawn(value: Any, std: float) -> str:
    """Return a value in the digits of a drawing: to 1 % of the standard deviation, or of a smaller value itself."""
    if isinstance(value, tuple | list):
        return f"[{', '.join(_as_drawn(x, std) for x in value)}]"
    places = format_numbers.decimals_for(min(std, abs(value)) if value else std)
    return format_numbers.plain(round(value, places))


class ProcessCost(TableModel, strict=True):
    """One process that makes a variable."""

    std: PositiveNumber = Field(description="Standard deviation that it reaches, in the variable's unit, above 0.")
    cost: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = Field(description="Cost in money, at least 0.")
    name: Annotated[str, Field(max_length=60)] = Field("", description="Name of the process.")


class Cost(TableModel, strict=True):
    """The cost of a standard deviation of one variable.

    ``fixed + cost / std``; with `power`, ``fixed + cost / std^power``; with `scale`,
    ``fixed + cost exp(-std / scale)``; with `processes`, one of them.
    """

    fixed: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = Field(
        0.0, description="Cost that does not depend on the standard deviation, in money, at least 0."
    )
    cost: PositiveNumber | None = Field(
        None, description="Cost above 0, in money times the variable's unit to the power; with scale, in money."
    )
    power: PositiveNumber | None = Field(None, description="Power of std in fixed + cost / std^power, above 0.")
    scale: PositiveNumber | None = Field(
        None, description="Scale of fixed + cost exp(-std / scale), above 0, in the variable's unit."
    )
    processes: Annotated[list[ProcessCost], Field(min_length=1, max_length=100)] | None = Field(
        None, description="Processes of which one is chosen: a list of {std, cost, name}."
    )
    lower: PositiveNumber | None = Field(
        None,
        description="Least standard deviation to choose, in the variable's unit; a tenth of the present one if absent.",
    )
    upper: PositiveNumber | None = Field(
        None,
        description="Largest standard deviation to choose, in the variable's unit; ten times the present if absent.",
    )
    locked: bool = Field(False, description="Whether the variable keeps its present standard deviation.")

    @model_validator(mode="after")
    def _is_one_law(self) -> Self:
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

    def bounds(self, std: float) -> tuple[float, float]:
        """Return between which standard deviations one is chosen, where the present one is `std`."""
        return self.lower or 0.1 * std, self.upper or 10 * std


class Costs(TableModel, strict=True):
    """A cost file."""

    target: PositiveNumber = Field(CAPABLE, description="Cpk that every response with limits must have, above 0.")
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


def read_cost_text(text: str, plan: Plan) -> Costs:
    """Return the costs in the text of a cost file, as `read_costs` does."""
    try:
        tables = parse_toml(text_bytes(text))
    except UnfitToml as error:
        raise SpecError(f"costs: {error}") from error
    return costs_of(tables, plan, "costs:")


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

    def rescale(factors: Mapping[str, float], rows: NDArray[np.intp]) -> Change:
        return spreads.change(factors, {name: samples[name][rows] for name in plan.spec.variables})

    with _advice_errors(plan):
        inputs, responses = {n: samples[n] for n in plan.spec.variables}, {name: samples[name] for name in limits}
        shares = {
            r.response: {i.variable: max(i.first_order or 0.0, 0.0) for i in r.influences}
            for r in sensitivity(inputs, responses, limits).responses
        }
        requirements = [
            Requirement(name, float(x.mean()), float(x.std(ddof=1)), *limits[name], costs.target, _parts(shares[name]))
            for name, x in values.items()
            if x.size > 1
        ]
        responses = {requirement.response: samples[requirement.response] for requirement in requirements}
        emulation = None
        if lots_of(plan, columns.number) is None:  # lots share a shift: few, however many samples are emulated
            rows = {name: samples[name] for name in varied(plan.spec)}
            emulation = EmulatedTolerances(rows, responses, limits, spreads.drawn)
        found = allocate(variables, requirements, responses, rescale, correlated, emulation)
        return replace(found, written={name: spreads.written(name, factor) for name, factor in found.factors.items()})


@contextmanager
def _advice_errors(plan: Plan) -> Iterator[None]:
    try:
        yield
    except ReportError as error:
        raise CampaignError(f"advice of {plan.campaign_id}: {error}") from error


def _given_limits(plan: Plan) -> Limits:
    return {name: pair for name, pair in limits_of(plan).items() if pair != (None, None)}


def advice_document(plan: Plan, store_url: str, advised: ToleranceAdvice) -> dict[str, Any]:
    """Return the advice as data, as ``clearcap advise --json`` and the web service write it."""
    short = {each.response: each for each in advised.shortfalls}
    return {
        **{"campaign": plan.campaign_id, "store": store_url},
        **{"advice": [asdict(each) for each in advised.growth], "kept": advised.kept, "kept_at": advised.kept_at},
        "below": {name: [asdict(a) for a in each.alone] for name, each in short.items()},
        "together": {name: each.together and asdict(each.together) for name, each in short.items()},
        "remedies": {name: each.text for name, each in short.items()},
        "note": advised.note,
    }


def allocation_document(plan: Plan, store_url: str, proposal: Allocation) -> dict[str, Any]:
    """Return the cheapest tolerances as ``clearcap advise --cost FILE --json`` and the web service write them."""
    return {"campaign": plan.campaign_id, "store": store_url, "allocation": asdict(proposal)}


def _parts(shares: Mapping[str, float]) -> dict[str, float]:
    """Return estimated shares as parts of one variance: their sum is at most 1."""
    total = max(sum(shares.values()), 1.0)
    return {name: share / total for name, share in shares.items()}


def _costed(name: str, distribution: Distribution, cost: Cost, spreads: Spreads) -> CostedVariable:
    std = distribution.moments()[1]
    lower, upper = cost.bounds(std)
    largest = spreads.of_variable(name, upper / std).factor * std if upper > std else upper
    return CostedVariable(name, std, cost.law(), lower, max(min(upper, largest), lower), cost.locked)
