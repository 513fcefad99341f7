"""Points, directions and matrices of OCCT as arrays, and the sub-shapes of a shape as lists.

Faces, edges and solids are listed without repetitions, in the same order for each instance of a product.
"""

from typing import Any

import numpy as np
from OCP import Standard
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp

from engine.arrays import Array

OCCT_ERRORS = tuple(each for each in vars(Standard).values() if isinstance(each, type) and issubclass(each, Exception))
"""What OCCT raises; in Python its classes have no common base."""

FACE, EDGE, SOLID = TopAbs_ShapeEnum.TopAbs_FACE, TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_SOLID


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


class ShapeMap:
    """All sub-shapes of one kind, without repetitions."""

    def __init__(self, shape: Any, kind: Any) -> None:
        self._map = IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher()
        TopExp.MapShapes_s(shape, kind, self._map)

    def __len__(self) -> int:
        return int(self._map.Extent())

    def shapes(self) -> list[Any]:
        """Return the sub-shapes in order."""
        return [self._map.FindKey(place) for place in range(1, len(self) + 1)]

    def place(self, shape: Any) -> int:
        """Return the index of a sub-shape from 0, or -1 if it is not in the map."""
        return int(self._map.FindIndex(shape)) - 1
