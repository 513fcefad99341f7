"""Points, directions and matrices of OCCT as arrays."""

from typing import Any

import numpy as np

from engine.arrays import Array


def array3(value: Any) -> Array:
    """Return a point, a vector or a direction, shape (3,)."""
    return np.array([value.X(), value.Y(), value.Z()])


def matrix3(value: Any) -> Array:
    """Return a matrix of OCCT, shape (3, 3)."""
    return np.array([[value.Value(row, column) for column in (1, 2, 3)] for row in (1, 2, 3)])


def one_way(axis: Array) -> Array:
    """Return an axis with its largest component positive, because its sign in the file is arbitrary."""
    # rounded first: rounding errors must not decide which of two equal components is the largest
    return axis if axis[np.argmax(np.abs(axis).round(9))] > 0 else -axis
