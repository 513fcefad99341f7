"""Normal distributions: given by mean and standard deviation, or by limits on a drawing and an assumed capability."""

from collections.abc import Mapping
from functools import cached_property
from math import hypot
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field, model_validator

from campaign.inputs.distributions.base import StandardDeviation, check_parameter_groups
from campaign.inputs.distributions.continuous import Continuous
from campaign.inputs.drawing_limits import dimension_limits, fit_limits
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
        return drawn.middle if drawn is not None else self.mean or 0.0

    @property
    def scale(self) -> float:
        """Standard deviation before the cut."""
        drawn = self.drawn
        return drawn.width / (3.0 * self.cpk) if drawn is not None and self.cpk is not None else self.std or 0.0

    def check_parameters(self) -> None:
        """Raise ValueError unless one set of parameters is complete and the nominal lies within the bounds."""
        drawings = (("nominal", "tolerance", "cpk"), ("dimension", "cpk"), ("fit", "cpk"))
        check_parameter_groups(self, ("mean", "std"), *drawings, hint=self.hint)
        low, high = self.cut()
        if self.nominal is not None and not low <= self.nominal <= high:
            raise ValueError(
                f"nominal = {self.nominal:g} lies outside of [lower, upper] = [{low:g}, {high:g}];"
                " move the nominal or the bounds"
            )

    def parent(self) -> ClosedForm:
        return forms.normal(self.location, self.scale)

    def words(self) -> str:
        by = self.dimension or self.fit or f"tolerance {self.tolerance or 0.0:g}"
        origin = "" if self.cpk is None else f" ({by}, assumed Cpk {self.cpk:g})"
        return f"normal, mean {self.location:g}, sd {self.scale:g}{origin}"


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
