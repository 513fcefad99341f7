"""Distributions between two ends: uniform, triangular, beta, and those of a position zone and of sorted pairs."""

from functools import cached_property
from math import sqrt
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.base import Continuous, StandardDeviation, check_order, check_parameter_groups
from engine.drawing_limits import fit_limits
from engine.mechanism.base import Number, PositiveNumber
from reporting.distributions import forms
from reporting.distributions.forms import ClosedForm

Within = Annotated[tuple[Number, Number], Field(strict=False)]

LARGEST_EXPONENT = 1e12  # above it, quantiles are no longer in order


class Bounded(Continuous):
    """A distribution whose ``lower`` and ``upper`` are part of its definition; they hold in every production batch."""

    lower: Number = Field(description="Lower end of the distribution, in the target's unit; below the upper end.")
    upper: Number = Field(description="Upper end of the distribution, in the target's unit; above the lower end.")

    @property
    def width(self) -> float:
        """Distance between the ends."""
        return self.upper - self.lower


class Cut(Bounded):
    """A distribution between two ends that may be cut further."""

    within: Within | None = Field(
        default=None,
        description="Bounds [low, high] between the ends at which the distribution is cut, in the target's unit.",
    )

    def cut(self) -> tuple[float, float]:
        """Return the bounds to which the distribution is cut."""
        return self.within or (self.lower, self.upper)

    def check_parameters(self) -> None:
        """Raise ValueError unless ``within`` lies between the ends."""
        if self.within is None:
            return
        check_order(*self.within)
        if not self.lower <= self.within[0] or not self.within[1] <= self.upper:
            raise ValueError(
                f"within = [{self.within[0]:g}, {self.within[1]:g}] reaches beyond [lower, upper] ="
                f" [{self.lower:g}, {self.upper:g}]; keep it between them"
            )


class Uniform(Bounded):
    """Uniform distribution: every value of [lower, upper] is equally likely."""

    distribution: Literal["uniform"] = Field(description="Name of the distribution.")

    def parent(self) -> ClosedForm:
        return forms.uniform(self.lower, self.upper)

    def words(self) -> str:
        return "uniform"


class Triangular(Cut):
    """Triangular distribution: the density rises in a straight line from lower to mode and falls to upper."""

    distribution: Literal["triangular"] = Field(description="Name of the distribution.")
    mode: Number = Field(description="Most likely value, in the target's unit, from lower to upper.")

    def check_parameters(self) -> None:
        """Raise ValueError unless the mode lies between the ends."""
        super().check_parameters()
        if not self.lower <= self.mode <= self.upper:
            raise ValueError(
                f"mode = {self.mode:g} lies outside [lower, upper] = [{self.lower:g}, {self.upper:g}];"
                " move the mode or the bounds"
            )

    def parent(self) -> ClosedForm:
        return forms.triangular(self.lower, self.mode, self.upper)

    def words(self) -> str:
        ends = f" of [{self.lower:g}, {self.upper:g}]" if self.within else ""
        return f"triangular{ends}, mode {self.mode:g}"


class Beta(Cut):
    """Beta distribution: its density is proportional to (x - lower)^(alpha-1) (upper - x)^(beta-1)."""

    distribution: Literal["beta"] = Field(description="Name of the distribution.")
    alpha: PositiveNumber | None = Field(
        default=None, description="Exponent at the lower end, above 0; with beta, instead of mean and std."
    )
    beta: PositiveNumber | None = Field(default=None, description="Exponent at the upper end, above 0.")
    mean: Number | None = Field(
        default=None, description="Mean before any cut, in the target's unit; between lower and upper."
    )
    std: StandardDeviation = None

    def check_parameters(self) -> None:
        """Raise ValueError unless one set of parameters is complete and such a distribution exists."""
        super().check_parameters()
        check_parameter_groups(self, ("alpha", "beta"), ("mean", "std"))
        if max(self.alpha or 0.0, self.beta or 0.0) > LARGEST_EXPONENT:
            raise ValueError(f"alpha and beta: so narrow that digits are lost; allowed: up to {LARGEST_EXPONENT:g}")
        if self.mean is None or self.std is None:
            return
        if not self.lower < self.mean < self.upper:
            raise ValueError(
                f"mean = {self.mean:g} lies outside of (lower, upper) = ({self.lower:g}, {self.upper:g});"
                " move the mean or the bounds"
            )
        largest = float(np.sqrt((self.mean - self.lower) * (self.upper - self.mean)))
        if not self.std < largest:
            raise ValueError(
                f"std = {self.std:g}: too large for mean {self.mean:g} between {self.lower:g} and {self.upper:g}"
                f"; allowed: below {largest:.4g}; reduce std or widen the bounds"
            )

        if not self.std >= self.width / np.sqrt(LARGEST_EXPONENT):
            raise ValueError(
                f"std = {self.std:g}: too small beside upper - lower = {self.width:g}, digits would be lost; allowed:"
                f" from a millionth of it; enlarge std or bring the bounds nearer"
            )

    @property
    def exponents(self) -> tuple[float, float]:
        """Both exponents."""
        if self.alpha is not None and self.beta is not None:
            return self.alpha, self.beta
        mean, std = ((self.mean or 0.0) - self.lower) / self.width, (self.std or 0.0) / self.width
        total = mean * (1.0 - mean) / (std * std) - 1.0
        return mean * total, (1.0 - mean) * total

    def parent(self) -> ClosedForm:
        return forms.beta(*self.exponents, self.lower, self.upper)

    def words(self) -> str:
        alpha, beta = self.exponents
        ends = f" of [{self.lower:g}, {self.upper:g}]" if self.within else ""
        return f"beta{ends}, alpha {alpha:g}, beta {beta:g}"


# The distance of a feature from its true position, within a position zone of a diameter.


class Position(Continuous):
    """Distance of an axis or a point from its true position in a plane; its direction is a variable of its own."""

    distribution: Literal["position"] = Field(description="Name of the distribution.")
    zone: PositiveNumber = Field(
        description="Diameter of the position zone, in the target's unit, above 0: no distance exceeds half of it, as"
        " parts beyond it are sorted out."
    )
    std: StandardDeviation = Field(
        default=None,
        description="Standard deviation along each of two axes of a process that aims at the true position, above 0:"
        " the distance follows Rayleigh's distribution, cut at the zone. If absent, all places in the zone are equally"
        " likely.",
    )

    def cut(self) -> tuple[float, float]:
        """Return the bounds to which the distribution is cut: the zone too."""
        low, high = super().cut()
        return low, min(high, 0.5 * self.zone)

    def parent(self) -> ClosedForm:
        if self.std is None:
            return forms.triangular(0.0, 0.5 * self.zone, 0.5 * self.zone)
        return forms.weibull(0.0, 2.0, sqrt(2.0) * self.std)  # Rayleigh's

    def words(self) -> str:
        process = "uniform" if self.std is None else f"Rayleigh, sd {self.std:g} along each axis"
        return f"distance in a position zone of diameter {self.zone:g}, {process}"


# The clearance of two parts that are sorted into classes before they are mated (selective assembly).


class Selective(Continuous):
    """Radial clearance of a fit whose holes and shafts are inspected, sorted into classes, and mated class by class."""

    distribution: Literal["selective"] = Field(description="Name of the distribution.")
    fit: Annotated[str, Field(min_length=1, max_length=60)] = Field(
        description="Fit as on the drawing, in mm, such as '12 H7/g6': the value is the radial clearance, half the"
        " difference of the two diameters."
    )
    cpk: PositiveNumber = Field(
        description="Assumed Cpk of each of the two parts before they are inspected, above 0. Parts beyond the limits"
        " are sorted out."
    )
    classes: Annotated[int, Field(ge=1, le=20)] = Field(
        description="Number of classes of equal width into which the holes between their limits are sorted, and the"
        " shafts between theirs, 1 to 20; a hole gets any shaft of its class. 1: any shaft."
    )

    @cached_property
    def _form(self) -> ClosedForm:
        hole, shaft = fit_limits(self.fit)
        middle = (hole.low + hole.high - shaft.low - shaft.high) / 4
        sigmas = 6.0 * self.cpk
        spreads = (hole.high - hole.low) / sigmas, (shaft.high - shaft.low) / sigmas
        return forms.selective(middle, *spreads, 0.5 * sigmas, self.classes)

    def parent(self) -> ClosedForm:
        return self._form

    def words(self) -> str:
        many = f"mated in {self.classes} classes" if self.classes > 1 else "mated at random"
        return f"clearance of {self.fit}, each part with Cpk {self.cpk:g} between its limits, {many}"
