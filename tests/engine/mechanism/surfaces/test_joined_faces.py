"""Faces that become one surface: common edges, and sharp ones that are not common."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from engine.mechanism.surfaces.patches import joined_faces, meeting_edges, sharp_gap
from engine.mechanism.surfaces.surface import FreeFormSurface
from tests.each import each
from tests.engine.kernels.surface_shapes import graded_rectangle


def flap(angle: float, gap: float = 0.0, patches: tuple[int, int] = (1, 1)) -> np.ndarray:
    """Return the square x 0 to 2, turned down about its edge x = 0 by an angle [rad] from the plane z = 0."""
    x, y, z = np.moveaxis(graded_rectangle(1.0, 1.0, patches) + np.array([1.0, 0.0, 0.0]), -1, 0)
    return np.stack([gap + x * np.cos(angle), y, z - x * np.sin(angle)], axis=-1)


FLAT = graded_rectangle(1.0, 1.0, (1, 1)) - np.array([1.0, 0.0, 0.0])


def test_what_is_near_becomes_one():
    """Two squares that miss each other by a share of 1e-8 of their size have their edge in common then."""
    patches, moved = joined_faces([FLAT, flap(2.0, 1e-8)])
    np.testing.assert_array_equal(patches[0, 3], patches[1, 0])
    assert moved == pytest.approx([5e-9, 5e-9], rel=1e-6)
    meeting = meeting_edges(patches)
    assert meeting.is_open.sum() == 6
    assert not meeting.is_loose.any()
    assert sharp_gap(patches, meeting) is None


@each(("angle", "is_sharp"), [(1.0, False), (1.5, False), (1.65, True), (2.5, True), (-2.0, True)])
@each(("gap", "patches"), [(1e-4, (1, 1)), (0.0, (1, 2))])
def test_edges_that_are_not_the_same_may_not_be_sharp(angle, is_sharp, gap, patches):
    """Up to a right angle between the normals each of them tells the side; beyond, not."""
    joined, _ = joined_faces([FLAT, flap(angle, gap, patches)])
    meeting = meeting_edges(joined)
    assert meeting.is_loose.sum() == 1 + patches[1]
    found = sharp_gap(joined, meeting)
    assert (found is not None) == is_sharp
    if found:
        assert found[0] == 0
        assert found[1] in (1, 2)


def spline(control: Any) -> dict[str, Any]:
    """Describe a flat face by its four corners."""
    line = [0.0, 0.0, 1.0, 1.0]
    return {"degree": [1, 1], "knots_u": line, "knots_v": line, "control": control}


def test_a_surface_of_several_splines():
    """Three faces at the corner of a cube: one surface, whose plate has nine open edges less three."""
    o, x, y, z = [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]
    faces = [spline([[o, y], [x, [1, 1, 0]]]), spline([[o, z], [y, [0, 1, 1]]]), spline([[o, x], [z, [1, 0, 1]]])]
    surface = FreeFormSurface.model_validate({"faces": faces, "depth": 0.1})
    assert surface.conversion_error < 1e-15
    assert len(surface.conversion_errors) == 3
    assert len(surface.boundary) == 3 + 3 + 6
    again = FreeFormSurface.model_validate(surface.model_dump(mode="json", exclude_none=True))
    assert again == surface


def test_what_is_refused():
    """Two forms at once, weights without a form, faces without control points, and a sharp edge with a gap."""
    flat = spline([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]])
    steep = spline([[[1.001, 0, 0], [1.001, 1, 0]], [[0, 0, -0.5], [0, 1, -0.5]]])
    for table, words in (
        ({"faces": [flat], **flat}, "has no form, or more than one"),
        ({"faces": [flat], "weights": [[1.0]]}, "belongs to a B-spline surface"),
        ({"faces": []}, "0 faces; allowed: 1 to 1000"),
        ({"faces": [{**flat, "degree": [3, 1]}]}, "2 control points for degree 3"),
        ({"faces": [flat, steep]}, "meet at a sharp edge"),
    ):
        with pytest.raises(ValidationError, match=words.replace("?", r"\?")):
            FreeFormSurface.model_validate(table)
