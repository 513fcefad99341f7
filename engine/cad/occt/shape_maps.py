"""The faces, edges and solids of a shape without repetitions, in the same order for each instance of a product."""

from typing import Any

from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp

FACE, EDGE, SOLID = TopAbs_ShapeEnum.TopAbs_FACE, TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_SOLID


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
