"""Rigid bodies: mass, inertia and start pose."""

from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from engine.mechanism.base import (
    SMALLEST_NUMBER,
    Direction,
    Name,
    Number,
    Point,
    PositiveNumber,
    TableModel,
    Vector,
    is_number,
    refuse,
)
from engine.mechanism.components import Tensor
from engine.mechanism.quantities import Quantity

Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

_THREE = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
_INERTIA_SCHEMA: dict[str, Any] = {"anyOf": [_THREE, {**_THREE, "items": _THREE}]}
_OUTLINE_SCHEMA: dict[str, Any] = {"type": "array", "items": {**_THREE, "minItems": 2}, "minItems": 3}


def _inertia(value: Any) -> Matrix | None:
    """Read three principal moments or a full tensor, and refuse values that no rigid body can have."""
    if value is None:
        return None
    rows = value if isinstance(value, list | tuple) else ()
    if len(rows) == 3 and all(map(is_number, rows)):
        rows = np.diag(np.array(rows, dtype=float)).tolist()
    lengths = [len(row) if isinstance(row, list | tuple) else 0 for row in rows]
    if lengths != [3, 3, 3] or not all(is_number(x) for row in rows for x in row):
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


def _outline(value: Any) -> tuple[tuple[float, float, float], ...] | None:
    """Read the corners of a polygon, each [x, y] or [x, y, z]."""
    if value is None:
        return None
    corners = value if isinstance(value, list | tuple) else ()
    sound = [isinstance(c, list | tuple) and len(c) in (2, 3) and all(map(is_number, c)) for c in corners]
    if len(corners) < 3 or not all(sound):
        raise refuse(
            "not a polygon; allowed: three or more corners, each [x, y] or [x, y, z] of finite numbers, in the body "
            "frame; write the corners in order, the first one once"
        )
    return tuple((float(c[0]), float(c[1]), float(c[2]) if len(c) == 3 else 0.0) for c in corners)


class Body(TableModel):
    """A rigid body. At the start its frame is at ``origin``, rotated by ``angle`` about ``axis``."""

    fixed: bool = Field(default=False, strict=True, description="true for a body that never moves")
    mass: Annotated[PositiveNumber | None, Quantity("mass")] = Field(
        default=None, description="the mass of the body, a positive number"
    )
    inertia: Annotated[
        Matrix | None, BeforeValidator(_inertia), WithJsonSchema(_INERTIA_SCHEMA), Quantity("inertia"), Tensor()
    ] = Field(
        default=None,
        description="the inertia about the centre of mass in body axes: 3 x 3, or three principal moments",
    )
    material: Name | None = Field(
        default=None, description="the material the body is made of, as `between` of [materials] calls it"
    )
    center_of_mass: Point = Field(default=(0.0, 0.0, 0.0), description="the centre of mass, in the body frame")
    origin: Point = Field(default=(0.0, 0.0, 0.0), description="the origin of the body frame, in the world")
    axis: Direction = Field(default=(0.0, 0.0, 1.0), description="the axis about which the frame is turned")
    angle: Annotated[Number, Quantity("angle")] = Field(
        default=0.0, description="the angle by which the body frame is turned about axis"
    )
    velocity: Annotated[Vector, Quantity("speed")] = Field(
        default=(0.0, 0.0, 0.0), description="the initial velocity of the centre of mass, in the world"
    )
    angular_velocity: Annotated[Vector, Quantity("angular speed")] = Field(
        default=(0.0, 0.0, 0.0), description="the initial angular velocity, in body axes"
    )
    outline: Annotated[
        tuple[tuple[float, float, float], ...] | None, BeforeValidator(_outline), WithJsonSchema(_OUTLINE_SCHEMA)
    ] = Field(
        default=None,
        description="how pictures draw the body: the corners of a polygon, [x, y] or [x, y, z] each, in the body "
        "frame; without effect on its motion",
    )

    @model_validator(mode="after")
    def _moving_or_fixed(self) -> Self:
        for key in ("mass", "inertia"):
            if not self.fixed and getattr(self, key) is None:
                raise refuse("missing; a body that moves needs it; give it, or write fixed = true", key=key)
        for key in ("velocity", "angular_velocity"):
            if self.fixed and any(getattr(self, key)):
                raise refuse(
                    "a fixed body does not move; allowed: [0, 0, 0]; remove this key, or fixed = true",
                    key=key,
                    value=getattr(self, key),
                )
        return self
