"""Couplings of the coordinates of ideal joints: gears, racks, screws and belts, with or without backlash."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from engine.mechanism.base import Name, Number, Restitution, TableModel, refuse
from engine.mechanism.quantities import Quantity


class Term(TableModel):
    """A coordinate of an ideal joint, 0 at the start: rotation of its second side about the first axis, or its way."""

    joint: Name = Field(description="an ideal revolute, prismatic or cylindrical joint")
    of: Literal["angle", "travel"] | None = Field(
        default=None, description="which coordinate of a cylindrical joint; the others have only one"
    )
    factor: Annotated[Number, Quantity("number")] = Field(
        description="what it is multiplied with, not 0: a number of teeth, a radius, a lead over 2 pi"
    )

    @model_validator(mode="after")
    def _counts(self) -> Self:
        if self.factor == 0:
            raise refuse("a factor of 0 couples nothing; allowed: any other number; correct it", key="factor", value=0)
        return self


class Coupling(TableModel):
    """The sum of factor times coordinate over some joints stays 0, to within half the backlash on either side."""

    terms: Annotated[tuple[Term, ...], Field(min_length=2)] = Field(
        description="the coordinates, two or more: { joint, of, factor }"
    )
    backlash: Annotated[Number, Field(ge=0), Quantity("number")] = Field(
        default=0.0, description="how far the first coordinate is free while the others stand, in its unit, >= 0"
    )
    restitution: Annotated[Restitution, Quantity("number")] = Field(
        default=0.0, description="the coefficient of restitution of both flanks"
    )

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        seen: set[tuple[str, str | None]] = set()
        for i, term in enumerate(self.terms):
            if (term.joint, term.of) in seen:
                text = f"{term.joint} is there twice; allowed: every coordinate once; add up the factors"
                raise refuse(text, key=f"terms.{i}.joint", value=term.joint)
            seen.add((term.joint, term.of))
        return self
