"""The cost file of `clearcap advise --cost`, which states what a smaller standard deviation of a variable costs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, ValidationError, model_validator

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.spec.faults import structure_faults
from engine.mechanism.base import PositiveNumber, TableModel
from engine.platform.toml_file import UnfitToml, read_toml
from reporting.capability.verdict import CAPABLE
from reporting.tolerance.cost_laws import CostLaw, ExponentialLaw, PowerLaw, Process, ProcessTable


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
