"""The clearance of two parts that are sorted into classes before they are mated (selective assembly)."""

from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field

from campaign.inputs.distributions.continuous import Continuous
from campaign.inputs.drawing_limits import fit_limits
from engine.mechanism.base import PositiveNumber
from reporting.distributions import forms
from reporting.distributions.forms import ClosedForm


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
