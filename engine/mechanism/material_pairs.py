"""The contact laws of pairs of materials."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from engine.mechanism.base import (
    Friction,
    Name,
    NonNegative,
    PositiveNumber,
    Restitution,
    TableModel,
    added,
    check_one_at_rest,
    check_static,
    optional,
)
from engine.mechanism.loads import FrictionOverSpeed
from engine.mechanism.quantities import Quantity

MOST_ACROSS = 100.0  # factor between the coefficients of friction along and across a grain


class Material(TableModel):
    """The contact law of a pair of materials."""

    between: tuple[Name, Name] | None = optional(
        'the materials of the two bodies, in any order, such as ["steel", "plastic"]; where no joint or '
        "contact between them names a pair, this one holds"
    )
    friction: Friction = Field(description="the coefficient of friction, a number >= 0")
    static_friction: Friction | None = added(
        "the coefficient of friction until the contact slides, a number >= friction; default: friction"
    )
    friction_across: Annotated[PositiveNumber | None, Quantity("number")] = added(
        "the coefficient of friction across the grain of a contact's side, a number > 0; friction is then that along it"
    )
    restitution: Restitution = Field(default=0.0, description="the coefficient of restitution, from 0 to 1")
    friction_over_speed: FrictionOverSpeed | None = added(
        "what friction is multiplied with, over the sliding speed: { table }; default: 1"
    )
    rolling_friction: Annotated[NonNegative | None, Quantity("length")] = added(
        "the largest moment of a contact against rolling per normal force, a length >= 0; default: 0"
    )
    spinning_friction: Annotated[NonNegative | None, Quantity("length")] = added(
        "the largest moment of a contact about its normal per normal force, a length >= 0; default: 0"
    )

    @model_validator(mode="after")
    def _static_holds_more(self) -> Self:
        check_static(self.static_friction, self.friction)
        check_one_at_rest(self)
        return self
