"""The cost file of `clearcap advise --cost`: what a smaller standard deviation of a variable costs."""

from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.spec.faults import structure_faults
from engine.mechanism.base import PositiveNumber, TableModel
from engine.toml_file import UnfitToml, read_toml
from reporting.capability.verdict import CAPABLE


class Cost(TableModel, strict=True):
    """What a standard deviation of one variable costs: ``fixed + cost / std``."""

    fixed: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = Field(
        default=0.0, description="Cost that does not depend on the standard deviation, in money, at least 0."
    )
    cost: PositiveNumber = Field(description="Cost in money times the variable's unit, above 0.")
    lower: PositiveNumber | None = Field(
        default=None,
        description="Least standard deviation to choose, in the variable's unit; a tenth of the present one if absent.",
    )
    upper: PositiveNumber | None = Field(
        default=None,
        description="Largest standard deviation to choose, in the variable's unit; ten times the present if absent.",
    )
    locked: bool = Field(default=False, description="Whether the variable keeps its present standard deviation.")


class Costs(TableModel, strict=True):
    """A cost file."""

    target: PositiveNumber = Field(
        default=CAPABLE, description="Cpk that every response with limits must have, above 0."
    )
    variables: Annotated[dict[str, Cost], Field(min_length=1)] = Field(
        description="Cost of each variable by its name; variables that are not named stay as they are."
    )


def read_costs(path: Path, plan: Plan) -> Costs:
    """Read a cost file.

    Parameters
    ----------
    path : Path
        The file.
    plan : Plan
        The campaign whose variables it names.

    Raises
    ------
    SpecError
        With all faults of the file.
    """
    try:
        costs = Costs.model_validate(read_toml(path))
    except OSError as error:
        raise SpecError(f"cost file {path}: {error.strerror or error}; name a file that can be read") from error
    except UnfitToml as error:
        raise SpecError(f"cost file {path}: {error}") from error
    except ValidationError as error:
        raise SpecError("\n  ".join([f"cost file {path}:", *structure_faults(error, Costs)])) from error
    unknown = [name for name in costs.variables if name not in plan.spec.variables]
    if unknown:
        allowed = ", ".join(plan.spec.variables)
        raise SpecError(
            f"cost file {path}: variables.{unknown[0]}: the campaign has no such variable; allowed: {allowed}"
        )
    return costs
