"""Conversion of geometry to another unit of length."""

from dataclasses import is_dataclass, replace
from functools import cache
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np

from engine.cad.cad_model import LengthPower

_T = TypeVar("_T")


def in_unit(geometry: _T, millimetres: float) -> _T:
    """Return data in mm from a CAD file, or derived from it, in another unit of length, given in mm, > 0.

    Areas, volumes, inertias and densities change too; masses stay in g.
    """
    scaled: _T = _scaled(geometry, 0, 1.0 / millimetres)
    return scaled


def _scaled(value: Any, power: int, factor: float) -> Any:
    """Return a value times a power of the factor; in a dataclass, each field with its own power."""
    if is_dataclass(value) and not isinstance(value, type):
        each = _powers(type(value)).items()
        return replace(value, **{name: _scaled(getattr(value, name), own, factor) for name, own in each})
    if isinstance(value, tuple):
        return tuple(_scaled(entry, power, factor) for entry in value)
    if power and isinstance(value, float | np.ndarray):
        return value * factor**power
    return value


@cache
def _powers(kind: type) -> dict[str, int]:
    """Return the power of the unit of length for each field of a dataclass, by name."""
    return {name: _power(hint) for name, hint in get_type_hints(kind, include_extras=True).items()}


def _power(hint: Any) -> int:
    """Return the power annotated on a type or on one of its components; 0 if there is none."""
    if isinstance(hint, LengthPower):
        return hint.power
    return next((power for inner in get_args(hint) if (power := _power(inner))), 0)
