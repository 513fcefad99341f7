"""Rigid bodies: their mass and inertia, and how they lie and move at the start."""

from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, WithJsonSchema, model_validator

from engine.mechanism.base import (
    SMALLEST_NUMBER,
    Direction,
    Name,
    Number,
    Point,
    PositiveNumber,
    Radian,
    TableModel,
    Tensor,
    Vector,
    added,
    are_numbers,
    optional,
    refuse,
    unless_none,
)
from engine.mechanism.quantities import Quantity

Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


_THREE = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
_INERTIA_SCHEMA: dict[str, Any] = {"anyOf": [_THREE, {**_THREE, "items": _THREE}]}
_OUTLINE_SCHEMA: dict[str, Any] = {"type": "array", "items": {**_THREE, "minItems": 2}, "minItems": 3}


def _inertia(value: Any) -> Matrix:
    """Read three principal moments or a full tensor, and refuse values that no rigid body can have."""
    rows = value if isinstance(value, list | tuple) else ()
    if are_numbers(rows, 3):
        rows = np.diag(np.array(rows, dtype=float)).tolist()
    if len(rows) != 3 or not all(are_numbers(row, 3) for row in rows):
        raise refuse(
            "not an inertia; allowed: three rows of three finite numbers, or the three principal moments; "
            "give it about the centre of mass, in body axes"
        )
    tensor = np.array(rows, dtype=float)
    scale = np.abs(tensor).max() or 1.0
    shape = tensor / scale  # so that no number below overflows, however large
    if np.abs(shape - shape.T).max() > 1e-9:
        raise refuse("not symmetric; allowed: Ixy = Iyx, Ixz = Izx, Iyz = Izy; make both entries equal")
    moments = np.linalg.eigvalsh(shape)
    shown = ", ".join(f"{moment * float(scale):.6g}" for moment in moments.tolist())
    if moments[0] * scale < SMALLEST_NUMBER:
        raise refuse(
            f"not positive definite: principal moments {shown}; allowed: all three > 0, from {SMALLEST_NUMBER:g}; "
            "check signs and orders of magnitude"
        )
    if moments[0] + moments[1] < moments[2] * (1 - 1e-9):
        raise refuse(
            f"breaks the triangle inequality: principal moments {shown}; allowed: none above the sum of the "
            "other two, as for any real body; check units, and that it is taken about the centre of mass"
        )
    return tuple(tuple(row) for row in tensor.tolist())  # type: ignore[return-value]


def _outline(value: Any) -> tuple[tuple[float, ...], ...]:
    """Read the corners of a polygon, each [x, y] or [x, y, z]."""
    corners = value if isinstance(value, list | tuple) else ()
    if len(corners) < 3 or not all(are_numbers(c, 2) or are_numbers(c, 3) for c in corners):
        raise refuse(
            "not a polygon; allowed: three or more corners, each [x, y] or [x, y, z] of finite numbers, in the body "
            "frame; write the corners in order, the first one once"
        )
    return tuple(tuple(float(x) for x in (*c, 0.0)[:3]) for c in corners)


class Body(TableModel):
    """A rigid body. At the start its frame is at ``origin``, rotated by ``angle`` about ``axis``."""

    fixed: bool = Field(default=False, strict=True, description="true for a body that never moves")
    mass: Annotated[PositiveNumber | None, Quantity("mass")] = optional("the mass of the body, a positive number")
    inertia: Annotated[
        Matrix | None, unless_none(_inertia), WithJsonSchema(_INERTIA_SCHEMA), Quantity("inertia"), Tensor()
    ] = optional("the inertia about the centre of mass in body axes: 3 x 3, or three principal moments")
    material: Name | None = optional("the material the body is made of, as `between` of [materials] calls it")
    expansion: Annotated[Annotated[Number, Field(ge=-1e-3, le=1e-3)] | None, Quantity("expansion")] = added(
        "the coefficient of linear thermal expansion, a number; default: that of its material by name"
    )
    growth: Annotated[Annotated[Number, Field(ge=-0.5, le=0.5)] | None, Quantity("number")] = added(
        "by which share all lengths of the body exceed those of the file, as by shrinkage or moisture"
    )
    center_of_mass: Point = Field(default=(0.0, 0.0, 0.0), description="the centre of mass, in the body frame")
    origin: Point = Field(default=(0.0, 0.0, 0.0), description="the origin of the body frame, in the world")
    axis: Direction = Field(default=(0.0, 0.0, 1.0), description="the axis about which the frame is turned")
    angle: Radian = Field(default=0.0, description="the angle by which the body frame is turned about axis")
    velocity: Annotated[Vector, Quantity("speed")] = Field(
        default=(0.0, 0.0, 0.0), description="the initial velocity of the centre of mass, in the world"
    )
    angular_velocity: Annotated[Vector, Quantity("angular speed")] = Field(
        default=(0.0, 0.0, 0.0), description="the initial angular velocity, in body axes"
    )
    outline: Annotated[
        tuple[tuple[float, float, float], ...] | None, unless_none(_outline), WithJsonSchema(_OUTLINE_SCHEMA)
    ] = optional(
        "how pictures draw the body: the corners of a polygon, [x, y] or [x, y, z] each, in the body "
        "frame; without effect on its motion"
    )

    @model_validator(mode="after")
    def _moving_or_fixed(self) -> Self:
        for key in ("mass", "inertia"):
            if not self.fixed and getattr(self, key) is None:
                raise refuse("missing; a body that moves needs it; give it, or write fixed = true", key=key)
        for key in ("velocity", "angular_velocity"):
            if self.fixed and any(value := getattr(self, key)):
                text = "a fixed body does not move; allowed: [0, 0, 0]; remove this key, or fixed = true"
                raise refuse(text, key=key, value=value)
        return self
