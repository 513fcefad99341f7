"""The cost file of `clearcap advise --cost`: what making a variable to a standard deviation costs."""

import tomllib
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from campaign.errors import SpecError
from campaign.inputs.distributions import Number, Spread
from campaign.inputs.distributions.base import Table
from campaign.plan import Plan
from campaign.spec.messages import fault
from reporting.capability.verdict import CAPABLE


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
        costs = Costs.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise SpecError(f"cost file {path}: {error.strerror}; name a file that can be read") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SpecError(f"cost file {path}: no TOML: {error}; correct it") from error
    except ValidationError as error:
        lines = [fault(map(str, e["loc"]), e["input"], e["msg"]) for e in error.errors(include_url=False)]
        raise SpecError("\n  ".join([f"cost file {path}:", *lines])) from error
    unknown = [name for name in costs.variables if name not in plan.spec.variables]
    if unknown:
        allowed = ", ".join(plan.spec.variables)
        raise SpecError(f"cost file {path}: variables.{unknown[0]}: no variable of the campaign; allowed: {allowed}")
    return costs
