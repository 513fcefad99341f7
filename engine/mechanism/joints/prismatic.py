"""A slider in a guide: a block in a slot, or a shaft in a sleeve."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from engine.mechanism.base import Direction, PositiveLength, TableModel, check_perpendicular, refuse
from engine.mechanism.joints.base import Joint, Line, stations
from engine.mechanism.quantities import Quantity


class Slideway(Line):
    """The guide's or the slider's axis, and the direction of its height."""

    normal: Direction | None = Field(default=None, description="the direction of the height, across the axis")

    @model_validator(mode="after")
    def _across(self) -> Self:
        if self.normal is not None:
            check_perpendicular(self.axis, self.normal, ("axis", "normal"))
        return self


class Block(TableModel):
    """A rectangular block around the slider's ``point``; its eight corners can touch the faces of the slot."""

    half_length: PositiveLength = Field(description="half the length along the axis, a number > 0")
    half_height: PositiveLength = Field(description="half the height along the normal, a number > 0")
    half_width: PositiveLength = Field(description="half the width across both, a number > 0")


class Shaft(TableModel):
    """A cylinder on the slider's axis, in a sleeve on the axis of the guide."""

    radius: PositiveLength = Field(description="the radius of the shaft, a number > 0")
    rings: Annotated[tuple[float, ...], BeforeValidator(stations), Quantity("length")] = Field(
        description="the stations of the sleeve's rings along the guide's axis, one or more numbers"
    )
    turning: Literal["held", "free"] = Field(
        default="held", description="whether rotation about the axis is held (without play) or free"
    )


class Prismatic(Joint):
    """A slider that moves along the axis of its guide. An ideal one keeps its orientation relative to the guide."""

    SIDES: ClassVar[tuple[str, str]] = ("guide", "slider")
    CLEARANCE: ClassVar[str] = "clearance"
    CLEARANCES: ClassVar[tuple[str, ...]] = ("clearance", "width_clearance")

    type: Literal["prismatic", "clearance_prismatic"] = Field(description="the kind of joint")
    guide: Slideway = Field(description="the slot or sleeve: { body, point, axis, normal }")
    slider: Slideway = Field(description="the block or shaft: { body, point, axis, normal }")
    block: Block | None = Field(default=None, description="a block: { half_length, half_height, half_width }")
    shaft: Shaft | None = Field(default=None, description="a shaft: { radius, rings, turning }")
    clearance: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None, description="the play on each side of the height, or around the shaft, a number > 0"
    )
    width_clearance: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None, description="the play of a block on each side of its width, a number > 0"
    )

    def face_clearance(self, face: str) -> str:
        """Return the key of the clearance at a face of the slot or at a ring."""
        return "width_clearance" if face.startswith(("left", "right")) else self.CLEARANCE

    def _check_play(self) -> None:
        if (self.block is None) == (self.shaft is None):
            has = "no form" if self.block is None else "block and shaft"
            raise refuse(f"has {has}; allowed: exactly one of block, shaft; keep one, or make the joint an ideal one")
        if self.block is None:
            self._need("clearance")
            if self.width_clearance is not None:
                text = "a shaft has no width; allowed: with a block; remove it"
                raise refuse(text, key="width_clearance", value=self.width_clearance)
            return
        self._need("guide.normal", "slider.normal")
        if self.width_clearance is None:
            self._need("clearance")
