"""Joints that yield: a bushing of six stiffnesses and dampings, and a straight uniform beam, which acts like one.

By Euler and Bernoulli the beam between two frames is a bushing at its middle with EA/L along it, 12 EI/L^3 across it,
GJ/L about its axis and EI/L about the others: all that its 12 x 12 stiffness matrix holds.
"""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from engine.mechanism.base import (
    BodyPoint,
    Direction,
    Each,
    NonNegative,
    PairLaw,
    PositiveLength,
    PositiveNumber,
    TableModel,
    Vector,
    check_perpendicular,
    optional,
    refuse,
)
from engine.mechanism.joints import Joint
from engine.mechanism.quantities import Quantity

Six = tuple[float, float, float, float, float, float]
"""Along x, y, z and about x, y, z of the frame."""


def _none_negative(value: tuple[float, float, float]) -> tuple[float, float, float]:
    for axis, number in zip("xyz", value, strict=True):
        if number < 0:
            raise refuse(
                "negative, so it would drive what it should hold; allowed: >= 0; correct it", key=axis, value=number
            )
    return value


_Three = Annotated[Vector, AfterValidator(_none_negative), Each(ge=0.0)]


class Yielding(Joint):
    """Base class of the joints that yield. They are free of force as they are turned to each other at the start."""

    SIDES: ClassVar[tuple[str, str]] = ("a", "b")
    normal: Direction | None = optional(
        "the y of its frame, across its x, in the frame of a's body; default: the axis of that body most across x"
    )

    @model_validator(mode="after")
    def _has_no_contacts(self) -> Self:
        for key in PairLaw.model_fields:
            if (value := getattr(self, key)) is not None:
                text = "a joint that yields has no contacts, so nothing in it rubs or bounces; allowed: none; remove it"
                raise refuse(f"{text}, or give a damping", key=key, value=value)
        return self

    def acts(self, keys: Sequence[str]) -> bool:
        """Return whether what stands under these keys has an effect: it has no contacts."""
        return not keys or keys[0] not in PairLaw.model_fields

    def springs(self, length: float) -> tuple[Six, Six]:
        """Return the stiffnesses and the dampings in the frame of the joint, for ``length`` from a to b."""
        raise NotImplementedError


class Bushing(Yielding):
    """Six springs and dampers between two points that coincide without force, in a frame of body a."""

    type: Literal["bushing"] = Field(description="the kind of joint")
    a: BodyPoint = Field(description="one side: { body, point }")
    b: BodyPoint = Field(description="the other side: { body, point }")
    axis: Direction = Field(
        default=(1.0, 0.0, 0.0), description="the x of stiffnesses and dampings, in the frame of a's body"
    )
    stiffness: Annotated[_Three, Quantity("stiffness")] = Field(
        default=(0.0, 0.0, 0.0), description="force per displacement along x, y, z, three numbers >= 0"
    )
    torsional_stiffness: Annotated[_Three, Quantity("torsional stiffness")] = Field(
        default=(0.0, 0.0, 0.0), description="torque per angle about x, y, z, three numbers >= 0"
    )
    damping: Annotated[_Three, Quantity("damping")] = Field(
        default=(0.0, 0.0, 0.0), description="force per speed along x, y, z, three numbers >= 0"
    )
    torsional_damping: Annotated[_Three, Quantity("torsional damping")] = Field(
        default=(0.0, 0.0, 0.0), description="torque per angular speed about x, y, z, three numbers >= 0"
    )

    @model_validator(mode="after")
    def _holds(self) -> Self:
        if self.normal is not None:
            check_perpendicular(self.axis, self.normal, ("axis", "normal"))
        stiffnesses, dampings = self.springs(0.0)
        if not any((*stiffnesses, *dampings)):
            text = "neither holds nor damps anything; allowed: at least one number > 0; give stiffness = [x, y, z], or "
            raise refuse(f"{text}remove the joint", key="stiffness", value=list(self.stiffness))
        return self

    def springs(self, length: float) -> tuple[Six, Six]:
        """Return what the file gives, whatever the length."""
        return (*self.stiffness, *self.torsional_stiffness), (*self.damping, *self.torsional_damping)


class RectangularSection(TableModel):
    """The cross-section of a flat spring."""

    width: PositiveLength = Field(description="the side across the normal, a number > 0")
    thickness: PositiveLength = Field(description="the side along the normal, a number > 0")

    @property
    def moments(self) -> tuple[float, float, float, float]:
        """Area, torsion constant (of Saint-Venant, to 0.5 %), second moments about y (the normal) and z."""
        w, t = self.width, self.thickness
        a, b = max(w, t), min(w, t)
        torsion = a * b**3 * (1 / 3 - 0.21 * b / a * (1 - b**4 / (12 * a**4)))
        return w * t, torsion, t * w**3 / 12, w * t**3 / 12


class RoundSection(TableModel):
    """The cross-section of a bar or wire."""

    diameter: PositiveLength = Field(description="the diameter, a number > 0")

    @property
    def moments(self) -> tuple[float, float, float, float]:
        """Area, torsion constant, second moments about y and z."""
        area = math.pi / 4 * self.diameter**2
        second = area * self.diameter**2 / 16
        return area, 2 * second, second, second


class Section(TableModel):
    """The cross-section of any other beam; bending about the normal and about the direction across it."""

    area: Annotated[PositiveNumber, Quantity("area")] = Field(description="the area, a number > 0")
    torsion_constant: Annotated[PositiveNumber, Quantity("second moment of area")] = Field(
        description="J in the torsional stiffness G J / L; for a round one the polar moment, a number > 0"
    )
    about_normal: Annotated[PositiveNumber, Quantity("second moment of area")] = Field(
        description="the second moment of area about the normal, a number > 0"
    )
    across_normal: Annotated[PositiveNumber, Quantity("second moment of area")] = Field(
        description="the second moment of area about the direction across normal and axis, a number > 0"
    )

    @property
    def moments(self) -> tuple[float, float, float, float]:
        """Area, torsion constant, second moments about y and z."""
        return self.area, self.torsion_constant, self.about_normal, self.across_normal


class Beam(Yielding):
    """A straight uniform beam without mass, clamped to body a at one end and to body b at the other.

    It is free of force as drawn. It is a bushing at its middle whose x leads from a to b.
    """

    type: Literal["beam"] = Field(description="the kind of joint")
    a: BodyPoint = Field(description="one clamped end: { body, point }")
    b: BodyPoint = Field(description="the other clamped end: { body, point }")
    youngs_modulus: Annotated[PositiveNumber, Quantity("stress")] = Field(description="Young's modulus, a number > 0")
    poissons_ratio: Annotated[NonNegative, Field(le=0.5), Quantity("number")] = Field(
        default=0.3, description="Poisson's ratio, for the shear modulus E / (2 + 2 nu), from 0 to 0.5"
    )
    rectangle: RectangularSection | None = optional("its cross-section: { width, thickness }")
    round: RoundSection | None = optional("its cross-section: { diameter }")
    section: Section | None = optional("its cross-section: { area, torsion_constant, about_normal, across_normal }")
    damping_time: Annotated[NonNegative, Quantity("time")] = Field(
        default=0.0, description="each damping is the stiffness times this time, a number >= 0"
    )

    @model_validator(mode="after")
    def _one_section(self) -> Self:
        given = [key for key in ("rectangle", "round", "section") if getattr(self, key) is not None]
        if len(given) != 1:
            has = " and ".join(given) or "no cross-section"
            raise refuse(f"has {has}; allowed: exactly one of rectangle, round, section; keep or add one")
        return self

    def springs(self, length: float) -> tuple[Six, Six]:
        """Return the six stiffnesses at the middle of the beam, and its dampings."""
        area, torsion, about_y, about_z = next(
            shape.moments for shape in (self.rectangle, self.round, self.section) if shape is not None
        )
        E, G = self.youngs_modulus, self.youngs_modulus / (2 + 2 * self.poissons_ratio)
        across = 12 / length**3
        stiffness = (
            E * area / length,
            across * E * about_z,
            across * E * about_y,
            G * torsion / length,
            E * about_y / length,
            E * about_z / length,
        )
        return stiffness, tuple(self.damping_time * k for k in stiffness)  # type: ignore[return-value]
