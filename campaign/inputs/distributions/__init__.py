"""Distributions of the sampled inputs: one model each, read from ``[variables.NAME]`` of a campaign file.

A value depends, bit for bit, on its own uniform number alone and not on how many others are transformed with it: a row
must not depend on its batch. The formulas use scipy's element-wise special functions. ``scipy.stats`` has the same
distributions, but gives other bits (lognormal, Weibull, the upper tails of beta, uniform and triangular), and every
worker would pay for its import (half a second, 50 MB).
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Union, get_args

from pydantic import BeforeValidator, Field

from campaign.inputs.distributions.base import Continuous, Distribution, ProductionBatch
from campaign.inputs.distributions.bounded import Beta, Position, Selective, Triangular, Uniform
from campaign.inputs.distributions.discrete import Constant, Empirical, Geometric, Poisson
from campaign.inputs.distributions.normal import Normal, TruncatedNormal
from campaign.inputs.distributions.skewed import Exponential, Gamma, Lognormal, Weibull

__all__ = ["DISTRIBUTIONS", "Constant", "Continuous", "Distribution", "Empirical", "ProductionBatch", "Variable"]

DEFAULT = "truncated_normal"  # the distribution of a variable without the key `distribution`

DISTRIBUTIONS: dict[str, type[Distribution]] = {
    get_args(model.model_fields["distribution"].annotation)[0]: model
    for model in (
        TruncatedNormal,
        Normal,
        Uniform,
        Triangular,
        Selective,
        Position,
        Beta,
        Lognormal,
        Weibull,
        Exponential,
        Gamma,
        Poisson,
        Geometric,
        Empirical,
        Constant,
    )
}


def _with_default(entry: Any) -> Any:
    """Return a variable's table with the name of its distribution."""
    return {"distribution": DEFAULT, **entry} if isinstance(entry, Mapping) else entry


if TYPE_CHECKING:
    Variable = Distribution
else:
    Variable = Annotated[
        Annotated[Union[tuple(DISTRIBUTIONS.values())], Field(discriminator="distribution")],  # noqa: UP007
        BeforeValidator(_with_default),
    ]
