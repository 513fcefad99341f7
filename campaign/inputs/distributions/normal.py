"""Normal distributions: given by mean and standard deviation or by nominal, tolerance and assumed capability."""

from typing import ClassVar, Literal

from pydantic import Field

from campaign.inputs.distributions.base import StandardDeviation, check_parameter_groups
from campaign.inputs.distributions.continuous import Continuous
from engine.mechanism.base import Number, PositiveNumber
from reporting.distributions import forms
from reporting.distributions.forms import ClosedForm


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

    @property
    def location(self) -> float:
        """Mean before the cut."""
        return self.mean if self.mean is not None else self.nominal or 0.0

    @property
    def scale(self) -> float:
        """Standard deviation before the cut."""
        if self.tolerance is not None and self.cpk is not None:
            return self.tolerance / (3.0 * self.cpk)
        return self.std or 0.0

    def check_parameters(self) -> None:
        """Raise ValueError unless one set of parameters is complete and the nominal lies within the bounds."""
        check_parameter_groups(self, ("mean", "std"), ("nominal", "tolerance", "cpk"), hint=self.hint)
        low, high = self.cut()
        if self.nominal is not None and not low <= self.nominal <= high:
            raise ValueError(
                f"nominal = {self.nominal:g} lies outside of [lower, upper] = [{low:g}, {high:g}];"
                " move the nominal or the bounds"
            )

    def parent(self) -> ClosedForm:
        return forms.normal(self.location, self.scale)

    def words(self) -> str:
        origin = "" if self.cpk is None else f" (tolerance {self.tolerance:g}, assumed Cpk {self.cpk:g})"
        return f"normal, mean {self.location:g}, sd {self.scale:g}{origin}"


class TruncatedNormal(Normal):
    """Normal distribution cut to [lower, upper]; the default if a variable names no distribution."""

    hint: ClassVar[str] = "; or name another distribution: truncated_normal is used where none is named"

    distribution: Literal["truncated_normal"] = Field(  # type: ignore[assignment]
        default="truncated_normal", description="Name of the distribution."
    )
    lower: Number = Field(description="Lower bound of the values, in the target's unit; below the upper bound.")
    upper: Number = Field(description="Upper bound of the values, in the target's unit; above the lower bound.")

    def words(self) -> str:
        return f"truncated {super().words()}"
