"""Normal distributions: given by mean and standard deviation, or by a tolerance and what is assumed of the process.

That is a capability, or the inertia of inertial tolerancing (ISO 18391, NF XP E04-008): the root of sigma^2 plus the
square of the distance of the mean from the target. Both hold for a process that is off centre too.
"""

from collections.abc import Mapping
from functools import cached_property
from math import hypot, sqrt
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field, model_validator

from campaign.inputs.distributions.base import Continuous, StandardDeviation, check_parameter_groups
from engine.drawing_limits import dimension_limits, fit_limits
from engine.mechanism.base import Number, PositiveNumber
from reporting.distributions import forms
from reporting.distributions.forms import ClosedForm

DrawingText = Annotated[str | None, Field(min_length=1, max_length=60)]


class Drawn(NamedTuple):
    """What a drawing says of a value, in the target's unit."""

    middle: float  # between the limits
    width: float  # half of them, at which the assumed Cpk is counted
    low: float
    high: float


def _drawn(dimension: Any, fit: Any) -> Drawn | None:
    """Return what the text of a dimension or a fit says; None without one."""
    if isinstance(dimension, str):
        low, high = dimension_limits(dimension)
        return Drawn((low + high) / 2, (high - low) / 2, low, high)
    if isinstance(fit, str):
        hole, shaft = fit_limits(fit)
        low, high = (hole.low - shaft.high) / 2, (hole.high - shaft.low) / 2
        # The two diameters are independent: their variances add, not their tolerances.
        return Drawn((low + high) / 2, hypot(hole.high - hole.low, shaft.high - shaft.low) / 4, low, high)
    return None


class Normal(Continuous):
    """Normal distribution."""

    hint: ClassVar[str] = ""

    distribution: Literal["normal"] = Field(description="Name of the distribution.")
    mean: Number | None = Field(default=None, description="Mean before any cut, in the target's unit.")
    std: StandardDeviation = None
    nominal: Number | None = Field(
        default=None,
        description="Nominal value, which is the mean before any cut, in the target's unit; with tolerance and cpk,"
        " instead of mean and std; within the bounds.",
    )
    tolerance: PositiveNumber | None = Field(
        default=None, description="Half the width of the tolerance around the nominal, in the target's unit, above 0."
    )
    cpk: PositiveNumber | None = Field(
        default=None, description="Assumed Cpk of the manufacturer, above 0: std = tolerance / (3 cpk)."
    )
    dimension: DrawingText = Field(
        default=None,
        description="Dimension as on the drawing, in mm, such as '20 +0.05/-0.01', '12 H7' or '30 ISO 2768-m'; with"
        " cpk, instead of mean and std: the mean is the middle of its limits.",
    )
    fit: DrawingText = Field(
        default=None,
        description="Fit as on the drawing, in mm, such as '12 H7/g6'; with cpk, that of each of the two parts: the"
        " value is the radial clearance, half the difference of the two diameters.",
    )

    inertia: PositiveNumber | None = Field(
        default=None,
        description="Inertia of the process about the nominal, in the target's unit, above 0, as ISO 18391 and NF XP"
        " E04-008 limit it; with nominal, instead of mean and std: std = sqrt(inertia^2 - shift^2).",
    )
    shift: Number | None = Field(
        default=None,
        description="Distance of the mean from the nominal, or from the middle of the dimension, signed, in the"
        " target's unit; the stated cpk or inertia includes it; 0 if absent.",
    )
    sigma_shift: Number | None = Field(
        default=None, description="The same in standard deviations, such as 1.5; instead of shift."
    )
    inflation: Annotated[PositiveNumber | None, Field(ge=1.0, le=10.0)] = Field(
        default=None,
        description="Factor of the standard deviation that follows from a tolerance or an inertia, from 1 to 10, such"
        " as Bender's 1.5; 1 if absent.",
    )

    @cached_property
    def drawn(self) -> Drawn | None:
        """What the drawing says; None without one."""
        if self.tolerance is not None and self.nominal is not None:
            return Drawn(self.nominal, self.tolerance, self.nominal - self.tolerance, self.nominal + self.tolerance)
        return _drawn(self.dimension, self.fit)

    @property
    def location(self) -> float:
        """Mean before the cut."""
        drawn = self.drawn
        if drawn is None and self.inertia is None:
            return self.mean or 0.0
        middle = drawn.middle if drawn is not None else self.nominal or 0.0
        off = self.shift or 0.0
        return middle + (self.sigma_shift * self._stated if self.sigma_shift is not None else off)

    @property
    def scale(self) -> float:
        """Standard deviation before the cut."""
        if self.drawn is None and self.inertia is None:
            return self.std or 0.0
        return (self.inflation or 1.0) * self._stated

    @property
    def _stated(self) -> float:
        """Standard deviation with which the process has the stated capability or inertia, shifted as it is."""
        drawn, off, sigmas = self.drawn, abs(self.shift or 0.0), abs(self.sigma_shift or 0.0)
        if self.inertia is not None:
            return sqrt(max(self.inertia**2 - off**2, 0.0)) / sqrt(1.0 + sigmas**2)
        return (drawn.width - off) / (3.0 * (self.cpk or 1.0) + sigmas) if drawn is not None else 0.0

    def check_parameters(self) -> None:
        """Raise ValueError unless one set of parameters is complete and the nominal lies within the bounds."""
        drawings = (("nominal", "tolerance", "cpk"), ("dimension", "cpk"), ("fit", "cpk"), ("nominal", "inertia"))
        check_parameter_groups(self, ("mean", "std"), *drawings, hint=self.hint)
        self._check_shift()
        low, high = self.cut()
        if self.nominal is not None and not low <= self.nominal <= high:
            raise ValueError(
                f"nominal = {self.nominal:g} lies outside of [lower, upper] = [{low:g}, {high:g}];"
                " move the nominal or the bounds"
            )

    def _check_shift(self) -> None:
        """Raise ValueError if a shift or an inflation does not belong to what states the process, or is too large."""
        given = {key: x for key in ("shift", "sigma_shift", "inflation") if (x := getattr(self, key)) is not None}
        if given and self.mean is not None:
            raise ValueError(f"{next(iter(given))} belongs to a tolerance or an inertia; mean and std include it")
        shifted = [key for key in given if key != "inflation"]
        if len(shifted) > 1:
            raise ValueError("shift and sigma_shift are the same shift; give one of them")
        if shifted and self.fit is not None:
            raise ValueError(
                f"{shifted[0]} needs a process of its own, and a fit has two; allowed: with nominal or dimension;"
                " give mean and std of the clearance"
            )
        most = self.inertia if self.inertia is not None else self.drawn.width if self.drawn is not None else 0.0
        if self.shift is not None and not abs(self.shift) < most:
            limit = f"inertia = {most:g}" if self.inertia is not None else f"half the tolerance, {most:g}"
            raise ValueError(f"shift = {self.shift:g}: allowed: less than {limit}, which includes it; reduce the shift")

    def parent(self) -> ClosedForm:
        return forms.normal(self.location, self.scale)

    def words(self) -> str:
        by = self.dimension or self.fit or f"tolerance {self.tolerance or 0.0:g}"
        origin = [] if self.cpk is None else [by, f"assumed Cpk {self.cpk:g}"]
        origin += [] if self.inertia is None else [f"inertia {self.inertia:g}"]
        origin += [] if self.shift is None else [f"mean off by {self.shift:g}"]
        origin += [] if self.sigma_shift is None else [f"mean off by {self.sigma_shift:g} sigma"]
        origin += [] if self.inflation is None else [f"sd inflated by {self.inflation:g}"]
        words = f"normal, mean {self.location:g}, sd {self.scale:g}"
        return f"{words} ({', '.join(origin)})" if origin else words


class TruncatedNormal(Normal):
    """Normal distribution cut to [lower, upper]; the default if a variable names no distribution."""

    hint: ClassVar[str] = "; or name another distribution: truncated_normal is used where none is named"

    distribution: Literal["truncated_normal"] = Field(  # type: ignore[assignment]
        default="truncated_normal", description="Name of the distribution."
    )
    lower: Number = Field(
        description="Lower bound of the values, in the target's unit; below the upper bound. If absent, the smallest"
        " value that a dimension or a fit allows."
    )
    upper: Number = Field(
        description="Upper bound of the values, in the target's unit; above the lower bound. If absent, the largest"
        " value that a dimension or a fit allows."
    )

    @model_validator(mode="before")
    @classmethod
    def _bounds_of_drawing(cls, table: Any) -> Any:
        """Add the bounds that a drawing states: parts beyond them are sorted out."""
        texts = {key: table.get(key) for key in ("dimension", "fit")} if isinstance(table, Mapping) else {}
        if all(isinstance(text, str) for text in texts.values()) or not any(texts.values()):
            return table  # none, or both, which is refused below
        drawn = _drawn(**texts)
        return table if drawn is None else {"lower": drawn.low, "upper": drawn.high, **table}

    def words(self) -> str:
        return f"truncated {super().words()}"
