"""Distributions of the sampled inputs: one frozen model each, read from ``[variables.NAME]`` of a campaign.

A value depends on its own uniform number alone, bit for bit: not on how many others are transformed beside it. So
quantiles are written from correctly rounded arithmetic and scipy's element-wise special functions; NumPy's own
``exp``, ``log`` and ``power`` treat the last elements of an array by other instructions than the first ones.
"""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from campaign.inputs.distributions.base import Array, Distribution, PositiveNumber
from campaign.inputs.distributions.bounded import Beta, Triangular, Uniform
from campaign.inputs.distributions.continuous import Continuous, ProductionBatch
from campaign.inputs.distributions.discrete import Geometric, Poisson
from campaign.inputs.distributions.given import Constant, Empirical
from campaign.inputs.distributions.normal import Normal, TruncatedNormal
from campaign.inputs.distributions.skewed import Lognormal
from campaign.inputs.distributions.waiting import Exponential, Gamma, Weibull

__all__ = [
    "DEFAULT",
    "DISTRIBUTIONS",
    "Array",
    "Beta",
    "Constant",
    "Continuous",
    "Distribution",
    "Empirical",
    "Exponential",
    "Gamma",
    "Geometric",
    "Lognormal",
    "Normal",
    "Poisson",
    "PositiveNumber",
    "ProductionBatch",
    "Triangular",
    "TruncatedNormal",
    "Uniform",
    "Variable",
    "Weibull",
]

DEFAULT = "truncated_normal"  # what a variable without the key `distribution` is

DISTRIBUTIONS: dict[str, type[Distribution]] = {
    "truncated_normal": TruncatedNormal,
    "normal": Normal,
    "uniform": Uniform,
    "triangular": Triangular,
    "beta": Beta,
    "lognormal": Lognormal,
    "weibull": Weibull,
    "exponential": Exponential,
    "gamma": Gamma,
    "poisson": Poisson,
    "geometric": Geometric,
    "empirical": Empirical,
    "constant": Constant,
}


def _with_default(entry: Any) -> Any:
    """Return a variable's table with the name of its distribution."""
    return {"distribution": DEFAULT, **entry} if isinstance(entry, Mapping) else entry


Variable = Annotated[
    Annotated[
        TruncatedNormal
        | Normal
        | Uniform
        | Triangular
        | Beta
        | Lognormal
        | Weibull
        | Exponential
        | Gamma
        | Poisson
        | Geometric
        | Empirical
        | Constant,
        Field(discriminator="distribution"),
    ],
    BeforeValidator(_with_default),
]
