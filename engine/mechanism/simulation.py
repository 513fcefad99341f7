"""The settings of a run: its steps, its criterion of rest, and its phases."""

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, model_validator

from engine.mechanism.base import (
    Name,
    NonNegative,
    Number,
    PositiveLength,
    PositiveNumber,
    TableModel,
    added,
    is_number,
    optional,
    with_numbers,
)
from engine.mechanism.quantities import Quantity
from engine.mechanism.responses import Event


class Rest(TableModel):
    """The criterion of rest: for some time no measured quantity moves, and no contact that carries load."""

    window: Annotated[PositiveNumber, Quantity("time")] = Field(description="how long nothing may move, a number > 0")
    drift: PositiveLength = Field(
        description="what a measured length may change, and a loaded contact slip, meanwhile: a number > 0"
    )


class Adaptive(TableModel):
    """Longer time steps while everything is slow."""

    longest: Annotated[PositiveNumber, Quantity("time")] = Field(
        description="the longest time step, a number > 0; the shortest is step"
    )
    travel: PositiveLength = Field(
        description="how far a body may move in a step longer than the shortest, a number > 0"
    )


class Simulation(TableModel):
    """The default settings of a run."""

    step: Annotated[PositiveNumber, Quantity("time")] = Field(description="the time step, a number > 0")
    horizon: Annotated[PositiveNumber, Quantity("time")] = Field(description="the longest simulated time, a number > 0")
    tolerance: Annotated[PositiveNumber, Field(le=1e-3), Quantity("number")] = Field(
        default=1e-8, description="the relative residual of the friction problem at each step, 0 to 1e-3"
    )
    penetration: PositiveLength = Field(description="the largest gap violation after a step, a number > 0")
    wall_limit: Annotated[PositiveNumber, Quantity("real time")] = Field(
        default=60.0, description="the longest real time of a run, a number > 0; then its status is timeout"
    )
    joint_violation: PositiveLength = Field(
        default=0.0,
        validate_default=False,  # `_default_violation` replaces it; 0 itself is refused
        description="the largest violation of an ideal joint after a step, a number > 0; default: penetration / 100",
    )
    assembly_travel: Annotated[NonNegative | None, Quantity("length")] = added(
        "how far a body may be moved at most where parts overlap as drawn or ideal joints are open, a"
        " number >= 0; 0: not at all; default: 1 % of the extent of the mechanism"
    )
    scheme: Literal["combined", "moreau_jean"] = Field(
        default="combined",
        description="combined: impact law and projection of positions; moreau_jean: velocities only, gaps may drift",
    )
    theta: Annotated[Number, Field(ge=0.5, le=1), Quantity("number")] = Field(
        default=0.5, description="where in a step loads and contacts are taken, 0.5 (second order) to 1 from its end"
    )
    adaptive: Adaptive | None = optional(
        "longer steps while everything is slow: { longest, travel }; default: one fixed step"
    )
    rest: Rest = Field(description="the stop criterion: { window, drift }")

    @model_validator(mode="before")
    @classmethod
    def _default_violation(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict) or "joint_violation" in data:
            return data
        penetration = data.get("penetration")
        if isinstance(penetration, str) and info.context is not None:  # the base class replaces it only later
            penetration = with_numbers(penetration, info.context, "penetration")
        if penetration is None or not is_number(penetration):
            return data
        return {**data, "joint_violation": 0.01 * penetration}


class Phase(TableModel):
    """A part of the run; it ends at rest, after ``duration`` or at the event ``until``, whichever comes first."""

    name: Name = Field(description="what forces and torques call it")
    duration: Annotated[PositiveNumber | None, Quantity("time")] = optional(
        "how long it lasts, a number > 0; default: until its event, or rest"
    )
    until: Event | None = optional("the event that ends it: { response, above } or { response, below }; default: none")
    damping: Annotated[NonNegative, Quantity("rate")] = Field(
        default=0.0,
        description="rate of a drag on every body in proportion to its mass, a number >= 0; default: 0, none",
    )
