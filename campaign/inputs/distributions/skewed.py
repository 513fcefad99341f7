"""Distributions of values above an origin, with a tail to the right: exponential, gamma, lognormal, Weibull."""

from abc import abstractmethod
from functools import cached_property
from math import exp as exp_of
from math import lgamma
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.base import TAIL, Continuous, StandardDeviation, check_parameter_groups
from engine.mechanism.base import Number, PositiveNumber
from reporting.distributions import forms
from reporting.distributions.forms import ClosedForm

WIDEST = 1e12  # ratio of std and mean, or its inverse: the square is still far from overflow
SHAPES = (0.2, 1000.0)  # range of Weibull's shapes that mean and std can give; at its ends std / mean is 15.8, 0.00128


class Skewed(Continuous):
    """A distribution of values above an origin; ``natural_keys`` are its parameters other than mean and std.

    ``title`` is its name in words, and ``natural_words`` has places for those parameters.
    """

    natural_keys: ClassVar[tuple[str, ...]]
    title: ClassVar[str]
    natural_words: ClassVar[str] = "shape {:g}, scale {:g}"

    origin: Number = Field(default=0.0, description="Lowest possible value before any cut, in the target's unit.")
    mean: Number | None = Field(
        default=None, description="Mean before any cut, origin included, in the target's unit; above the origin."
    )
    std: StandardDeviation = None

    def check_parameters(self) -> None:
        """Raise ValueError unless one set of parameters is complete and such a distribution exists."""
        check_parameter_groups(self, self.natural_keys, ("mean", "std"))
        self.check_mean()

    def check_mean(self) -> None:
        """Raise ValueError unless the mean lies above the origin and std is in a plausible ratio to it."""
        if self.mean is not None and not self.mean > self.origin:
            raise ValueError(
                f"mean = {self.mean:g} is not above origin = {self.origin:g}, below which there is no value;"
                " raise the mean or lower the origin"
            )

        if self.mean is not None and self.std is not None and not 1.0 / WIDEST <= self.variation <= WIDEST:
            raise ValueError(
                f"std = {self.std:g} is {self.variation:.3g} times the mean above the origin, {self.height:g}; allowed:"
                f" {1.0 / WIDEST:g} to {WIDEST:g} times; change std, mean or origin"
            )

    def tried(self) -> tuple[float, float]:
        """Return the ends, with the quantile also in place of the origin, which is never drawn."""
        low, high = self.ends()
        cut = self.batch is not None or (self.lower is not None and self.lower > self.origin)
        return (low if cut else float(self.ppf(np.array([TAIL]))[0])), high

    @property
    def height(self) -> float:
        """The mean minus the origin, if the mean is given."""
        return (self.mean or 0.0) - self.origin

    @property
    def variation(self) -> float:
        """Standard deviation divided by the mean above the origin, if both are given."""
        return (self.std or 0.0) / self.height

    @property
    @abstractmethod
    def parameters(self) -> tuple[float, ...]:
        """The natural parameters."""

    def words(self) -> str:
        given = f"mean {self.mean:g}, sd {self.std:g}" if self.mean is not None and self.std is not None else ""
        words = f"{self.title}, {given or self.natural_words.format(*self.parameters)}"
        return f"{words}, origin {self.origin:g}" if self.origin else words


class Exponential(Skewed):
    """Exponential distribution: its standard deviation and its mean above the origin both equal its scale."""

    title: ClassVar[str] = "exponential"
    natural_words: ClassVar[str] = "scale {:g}"

    distribution: Literal["exponential"] = Field(description="Name of the distribution.")
    scale: PositiveNumber | None = Field(
        default=None,
        description="Scale in the target's unit, above 0, instead of mean or std: mean = origin + scale, std = scale.",
    )

    def check_parameters(self) -> None:
        """Raise ValueError unless exactly one parameter is given."""
        check_parameter_groups(self, ("scale",), ("mean",), ("std",))
        self.check_mean()

    @property
    def parameters(self) -> tuple[float, ...]:
        """The scale."""
        return (self.scale or self.std or self.height,)

    def parent(self) -> ClosedForm:
        return forms.exponential(self.origin, *self.parameters)


class Gamma(Skewed):
    """Gamma distribution above an origin."""

    natural_keys: ClassVar[tuple[str, ...]] = ("shape", "scale")
    title: ClassVar[str] = "gamma"

    distribution: Literal["gamma"] = Field(description="Name of the distribution.")
    shape: PositiveNumber | None = Field(
        default=None, description="Shape, above 0; with scale, instead of mean and std: mean = origin + shape * scale."
    )
    scale: PositiveNumber | None = Field(
        default=None, description="Scale in the target's unit, above 0: variance = shape * scale^2."
    )

    @property
    def parameters(self) -> tuple[float, float]:
        """Shape and scale."""
        if self.shape is not None and self.scale is not None:
            return self.shape, self.scale
        return 1.0 / self.variation**2, self.height * self.variation**2

    def parent(self) -> ClosedForm:
        return forms.gamma(self.origin, *self.parameters)


class Lognormal(Skewed):
    """Lognormal distribution: the logarithm of (value - origin) is normal."""

    natural_keys: ClassVar[tuple[str, ...]] = ("log_mean", "log_std")
    title: ClassVar[str] = "lognormal"
    natural_words: ClassVar[str] = "mean {:g} and sd {:g} of the logarithm"

    distribution: Literal["lognormal"] = Field(description="Name of the distribution.")
    log_mean: Number | None = Field(
        default=None,
        description="Mean of the natural logarithm of (value - origin); with log_std, instead of mean and std.",
    )
    log_std: PositiveNumber | None = Field(
        default=None, description="Standard deviation of the natural logarithm of (value - origin), above 0."
    )

    @cached_property
    def parameters(self) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm."""
        if self.log_mean is not None and self.log_std is not None:
            return self.log_mean, self.log_std
        variance = float(np.log1p(self.variation**2))
        return float(np.log(self.height)) - 0.5 * variance, float(np.sqrt(variance))

    def parent(self) -> ClosedForm:
        return forms.lognormal(self.origin, *self.parameters)


class Weibull(Skewed):
    """Weibull distribution: ((value - origin) / scale)^shape is exponential."""

    natural_keys: ClassVar[tuple[str, ...]] = ("shape", "scale")
    title: ClassVar[str] = "Weibull"

    distribution: Literal["weibull"] = Field(description="Name of the distribution.")
    shape: PositiveNumber | None = Field(
        default=None, description="Exponent of the distribution, above 0; with scale, instead of mean and std."
    )
    scale: PositiveNumber | None = Field(
        default=None, description="Scale in the target's unit, above 0: 63.2 % of the values lie below origin + scale."
    )

    def check_mean(self) -> None:
        """Raise ValueError unless a Weibull distribution with this mean and standard deviation exists."""
        super().check_mean()
        most, least = (forms.weibull_variation(shape) for shape in SHAPES)
        if self.mean is not None and not least < self.variation < most:
            raise ValueError(
                f"std = {self.std:g} is {self.variation:.3g} times the mean above the origin, {self.height:g}; allowed"
                f" for a Weibull distribution: {least:.3g} to {most:.3g} times; change std, mean or origin"
            )

    @cached_property
    def parameters(self) -> tuple[float, float]:
        """Shape and scale; if mean and std are given, found by bisection, since std / mean falls with the shape."""
        if self.shape is not None and self.scale is not None:
            return self.shape, self.scale
        low, high = SHAPES
        # more halvings than a double has digits: it ends at two neighbouring numbers
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if forms.weibull_variation(middle) > self.variation else (low, middle)
        return low, self.height / exp_of(lgamma(1.0 + 1.0 / low))

    def parent(self) -> ClosedForm:
        return forms.weibull(self.origin, *self.parameters)
