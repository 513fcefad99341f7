"""Faces that look at each other across a small gap."""

import numpy as np
import pytest

from engine.cad.findings.facing_planes import facing_planes, thrust_faces, triangles_by_face
from engine.cad.findings.joints import pins_in_holes
from tests.engine.cad import latch
from tests.engine.cad.step_files import Drawing, box


def blocks(second):
    """Return a drawing of two blocks."""
    made = Drawing()
    top = made.assembly("blocks")
    made.add(top, made.product("a", box((0.0, 0.0, 0.0), (10.0, 10.0, 10.0))))
    made.add(top, made.product("b", second))
    return made


def test_the_latch(read):
    """Nine pairs; eight are flanges of its joints, the ninth is the stop, 0.8 mm away."""
    assembly = read(latch.drawing())
    triangles = triangles_by_face(assembly)
    flanges = {
        frozenset((each.bearing_face, each.journal_face))
        for joint in pins_in_holes(assembly)[0]
        for each in thrust_faces(assembly, joint, triangles)
    }
    pairs = facing_planes(assembly, triangles)
    assert len(pairs) == 9
    [stop] = [pair for pair in pairs if frozenset(pair.faces) not in flanges]
    assert stop.parts == ("base", "crank")
    assert stop.gap == pytest.approx(latch.STOP_GAP, abs=1e-9)
    assert stop.area == pytest.approx(7.0 * (latch.THICKNESS - latch.AXIAL_PLAY), rel=1e-9)
    np.testing.assert_allclose(stop.middle, [7.8, 11.5, (latch.AXIAL_PLAY + latch.THICKNESS) / 2], atol=1e-9)


def test_gap_area_and_middle(read):
    """Of two blocks beside each other that share a part of a face."""
    [pair] = facing_planes(*with_triangles(read(blocks(box((10.4, 4.0, 5.0), (3.0, 20.0, 20.0))))))
    assert (pair.gap, pair.area) == pytest.approx((0.4, 30.0), abs=1e-9)
    np.testing.assert_allclose(pair.middle, [10.0, 7.0, 7.5], atol=1e-9)
    np.testing.assert_allclose(pair.normal, [1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("corner", "gaps"),
    [
        ((11.5, 0.0, 0.0), []),  # too far
        ((10.4, 10.1, 0.0), []),  # beside each other
        ((10.4, 10.0, 0.0), []),  # with an edge in common
        ((9.95, 0.0, 0.0), [-0.05]),  # overlapping a little
        ((8.0, 0.0, 0.0), []),  # one inside the other
    ],
)
def test_where_they_end(read, corner, gaps):
    """A gap up to 1 mm, a share of both faces, and no more than a small overlap."""
    found = facing_planes(*with_triangles(read(blocks(box(corner, (3.0, 20.0, 20.0))))))
    assert [pair.gap for pair in found] == pytest.approx(gaps, abs=1e-9)


@pytest.mark.parametrize(("apart", "gaps"), [(0.02, [0.02]), (0.3, [])])
def test_very_small_parts(read, apart, gaps):
    """Blocks of 0.3 mm face each other over less than a usual sliver, and not across as much as their own size."""
    made = Drawing()
    top = made.assembly("blocks")
    for x in (0.0, 0.3 + apart):
        made.add(top, made.product("block", box((x, 0.0, 0.0), (0.3, 0.3, 0.3))))
    found = facing_planes(*with_triangles(read(made)))
    assert [pair.gap for pair in found] == pytest.approx(gaps, abs=1e-9)
    assert [pair.area for pair in found] == pytest.approx([0.09] * len(gaps), rel=1e-9)


def with_triangles(assembly):
    """Return an assembly and its triangles."""
    return assembly, triangles_by_face(assembly)
