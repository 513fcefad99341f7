"""Distributions of the sampled inputs: one model each, read from ``[variables.NAME]`` of a campaign file.

A value depends, bit for bit, on its own uniform number alone and not on how many others are transformed with it: a row
must not depend on its batch. The formulas use scipy's element-wise special functions. ``scipy.stats`` has the same
distributions, but gives other bits (lognormal, Weibull, the upper tails of beta, uniform and triangular), and every
worker would pay for its import (half a second, 50 MB).
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Union, get_args

from pydantic import BeforeValidator, Field

from campaign.inputs.distributions.base import Distribution
from campaign.inputs.distributions.beta import Beta
from campaign.inputs.distributions.constant import Constant
from campaign.inputs.distributions.continuous import Continuous
from campaign.inputs.distributions.empirical import Empirical
from campaign.inputs.distributions.exponential import Exponential
from campaign.inputs.distributions.gamma import Gamma
from campaign.inputs.distributions.geometric import Geometric
from campaign.inputs.distributions.lognormal import Lognormal
from campaign.inputs.distributions.normal import Normal
from campaign.inputs.distributions.poisson import Poisson
from campaign.inputs.distributions.production_batch import ProductionBatch
from campaign.inputs.distributions.triangular import Triangular
from campaign.inputs.distributions.truncated_normal import TruncatedNormal
from campaign.inputs.distributions.uniform import Uniform
from campaign.inputs.distributions.weibull import Weibull

__all__ = [
    "DISTRIBUTIONS",
    "Constant",
    "Continuous",
    "Distribution",
    "Empirical",
    "ProductionBatch",
    "Variable",
]

DEFAULT = "truncated_normal"  # the distribution of a variable without the key `distribution`

DISTRIBUTIONS: dict[str, type[Distribution]] = {
    get_args(model.model_fields["distribution"].annotation)[0]: model
    for model in (
        TruncatedNormal,
        Normal,
        Uniform,
        Triangular,
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
