"""Distributions of values above an origin, with a tail to the right."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.base import StandardDeviation, check_parameter_groups
from campaign.inputs.distributions.continuous import Continuous
from engine.arrays import Array
from engine.mechanism.base import Number

WIDEST = 1e12  # ratio of std and mean, or its inverse: the square is still far from overflow


class Skewed(Continuous):
    """A distribution of values above an origin; ``natural_keys`` are its parameters other than mean and std."""

    natural_keys: ClassVar[tuple[str, ...]]

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

    @property
    def height(self) -> float:
        """The mean minus the origin, if the mean is given."""
        return (self.mean or 0.0) - self.origin

    @property
    def variation(self) -> float:
        """Standard deviation divided by the mean above the origin, if both are given."""
        return (self.std or 0.0) / self.height

    def above(self, x: Array) -> Array:
        """Return the distance of ``x`` above the origin, 0 below it."""
        return np.maximum(x - self.origin, 0.0)

    def parent_support(self) -> tuple[float, float]:
        return self.origin, np.inf

    def named(self, parameters: str) -> str:
        """Return ``parameters``, a distribution in words, followed by the origin if it is not 0."""
        return f"{parameters}, origin {self.origin:g}" if self.origin else parameters
