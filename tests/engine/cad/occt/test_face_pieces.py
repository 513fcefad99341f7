"""Each kind of face: what it is, where it is, how much of it there is."""

from math import atan2, pi, sqrt, tau

import numpy as np
import pytest
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.BRepPrimAPI import BRepPrimAPI_MakeSphere, BRepPrimAPI_MakeTorus
from OCP.collections import Array2_gp_Pnt
from OCP.GeomAPI import GeomAPI_PointsToBSplineSurface
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

from tests.engine.cad.hinges import cut_in_two
from tests.engine.cad.step_files import Drawing, box, cone, cut, cylinder, fused, place


def alone(shape, name="part"):
    """Return a drawing of one part."""
    made = Drawing()
    made.product(name, shape)
    return made


def only(assembly, kind):
    """Return the one face of a kind."""
    [face] = [face for face in assembly.faces if face.kind == kind]
    return face


def test_a_tilted_cylinder(read):
    """Its axis, its extent from its middle, its area; it is no hole."""
    face = only(read(alone(cylinder((1.0, -2.0, 3.0), 2.0, 6.0, (1.0, 2.0, 2.0)))), "cylinder")
    axis = np.array([1.0, 2.0, 2.0]) / 3
    np.testing.assert_allclose(np.abs(face.axis @ axis), 1.0, atol=1e-12)
    np.testing.assert_allclose(face.point, np.array([1.0, -2.0, 3.0]) + 3 * axis, atol=1e-9)
    np.testing.assert_allclose(face.extent, [-3.0, 3.0], atol=1e-9)
    assert (face.radius, face.area, face.span, face.hollow) == (
        pytest.approx(2.0, abs=1e-9),
        pytest.approx(24 * pi, rel=1e-9),
        tau,
        False,
    )
    away = face.on - face.point
    assert np.linalg.norm(np.cross(away, axis)) == pytest.approx(2.0, abs=1e-9)
    assert away @ face.normal > 0


@pytest.mark.parametrize("drawn", [lambda shape: shape, cut_in_two], ids=["whole", "halves"])
def test_a_cone(read, drawn):
    """It widens along its axis, wherever it was drawn from; the radius is that at mid-height."""
    for radii in ((4.0, 1.0), (1.0, 4.0)):
        face = only(read(alone(drawn(cone((0.0, 0.0, 1.0), radii, 3.0)))), "cone")
        np.testing.assert_allclose(face.axis, [0.0, 0.0, np.sign(radii[1] - radii[0])], atol=1e-12)
        np.testing.assert_allclose(face.point, [0.0, 0.0, 2.5], atol=1e-9)
        assert (face.radius, face.half_angle) == pytest.approx((2.5, atan2(3.0, 3.0)), abs=1e-9)
        assert face.area == pytest.approx(pi * 5 * sqrt(18), rel=1e-8)
        assert face.span == pytest.approx(tau)


def test_a_pointed_cone_goes_all_round(read):
    """Its tip has no angle of its own."""
    face = only(read(alone(cone((0.0, 0.0, 0.0), (3.0, 0.0), 4.0))), "cone")
    assert face.span == pytest.approx(tau)
    assert face.radius == pytest.approx(1.5, abs=1e-9)


def test_a_ball_and_a_socket(read):
    """One is hollow, the other is not."""
    ball = BRepPrimAPI_MakeSphere(gp_Pnt(1.0, 2.0, 3.0), 2.0).Shape()
    for shape, hollow in ((ball, False), (cut(box((-5.0, -5.0, 3.0), (10.0, 10.0, 10.0)), ball), True)):
        face = only(read(alone(shape)), "sphere")
        np.testing.assert_allclose(face.point, [1.0, 2.0, 3.0], atol=1e-9)
        assert (face.radius, face.hollow) == (pytest.approx(2.0, abs=1e-9), hollow)


def test_a_torus_and_its_groove(read):
    """The outside of a ring, and the groove that it leaves."""
    ring = BRepPrimAPI_MakeTorus(gp_Ax2(gp_Pnt(0.0, 0.0, 1.0), gp_Dir(0.0, 0.0, 1.0)), 5.0, 1.0).Shape()
    for shape, hollow in ((ring, False), (cut(cylinder((0.0, 0.0, 0.0), 5.0, 2.0), ring), True)):
        face = only(read(alone(shape)), "torus")
        assert (face.radius, face.minor_radius, face.hollow) == (
            pytest.approx(5.0, abs=1e-9),
            pytest.approx(1.0, abs=1e-9),
            hollow,
        )


def test_planes_look_outwards(read):
    """The normals of a box point away from its middle, also those of a part that stands mirrored."""
    made = Drawing()
    top = made.assembly("top")
    product = made.product("box", box((0.0, 0.0, 0.0), (2.0, 3.0, 4.0)))
    made.add(top, product)
    mirror = place()
    mirror.SetMirror(made.plane((-5.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    made.add(top, product, mirror)
    assembly = read(made)
    for part in assembly.parts:
        middle = part.bounds.mean(axis=0)
        for face in assembly.faces_of(part.name):
            assert (face.on - middle) @ face.axis > 0
            np.testing.assert_allclose(face.axis, face.normal, atol=1e-12)
    for mesh, part in zip(
        assembly.meshes, assembly.parts, strict=True
    ):  # triangles turn outwards: their volume is that
        a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
        assert np.einsum("ni,ni->", a, np.cross(b, c)) / 6 == pytest.approx(24.0)
        assert part.solids[0].volume == pytest.approx(24.0, rel=1e-12)


def test_part_of_a_cylinder(read):
    """A quarter of a hole: its span, and where its middle is."""
    quarter = cut(box((0.0, 0.0, 0.0), (5.0, 5.0, 2.0)), cylinder((0.0, 0.0, -1.0), 3.0, 4.0))
    face = only(read(alone(quarter)), "cylinder")
    assert (face.span, face.hollow) == (pytest.approx(pi / 2, abs=1e-9), True)
    np.testing.assert_allclose(face.middle, [sqrt(0.5), sqrt(0.5), 0.0], atol=1e-9)


def test_two_bosses_of_one_plane_are_two_faces(read):
    """They lie in one plane, but are not one piece; two walls of one cylinder across a slot are one hole."""
    bosses = fused(box((0.0, 0.0, 0.0), (20.0, 5.0, 1.0)), *(box((x, 0.0, 1.0), (5.0, 5.0, 1.0)) for x in (0.0, 15.0)))
    assert sum(f.kind == "plane" and abs(f.point[2] - 2.0) < 1e-9 for f in read(alone(bosses)).faces) == 2
    slotted = cut(
        box((-5.0, -5.0, 0.0), (10.0, 10.0, 2.0)), cylinder((0, 0, -1), 3.0, 4.0), box((-4, -1, -1), (8, 2, 4))
    )
    hole = only(read(alone(slotted)), "cylinder")
    assert len(hole.places) == 2
    assert hole.span == pytest.approx(tau - 4 * np.arcsin(1 / 3), abs=1e-9)


def bowl(random):
    """Return a block whose top is a free-form surface, and the points that it goes through."""
    heights = 5.0 + random.uniform(-0.5, 0.5, (6, 6))
    points = Array2_gp_Pnt(1, 6, 1, 6)
    for i in range(6):
        for j in range(6):
            points.SetValue(i + 1, j + 1, gp_Pnt(2.0 * i, 2.0 * j, heights[i, j]))
    surface = GeomAPI_PointsToBSplineSurface()
    surface.Interpolate(points)
    return BRepBuilderAPI_MakeFace(surface.Surface(), 1e-6).Face(), heights


def test_a_free_form_face(read):
    """Its B-spline, evaluated by SciPy, goes through the points that it was made from."""
    face, heights = bowl(np.random.default_rng(3))
    assembly = read(alone(face))
    assert assembly.cautions == ("without a solid, so without volume: part; export these parts as solids",)
    [spline] = only(assembly, "surface").splines
    starts = [spline.knots[k][spline.degrees[k]] for k in (0, 1)]
    ends = [spline.knots[k][-1 - spline.degrees[k]] for k in (0, 1)]

    def at(parameters):
        """Return the point of the surface at its two parameters, shape (3,)."""
        across = BSpline(spline.knots[0], spline.points * spline.weights[:, :, None], spline.degrees[0])(parameters[0])
        weights = BSpline(spline.knots[0], spline.weights, spline.degrees[0])(parameters[0])
        along = [BSpline(spline.knots[1], each, spline.degrees[1])(parameters[1]) for each in (across, weights)]
        return along[0] / along[1]

    tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "x_scale": np.subtract(ends, starts)}
    for i in range(6):
        for j in range(6):
            wanted = [2.0 * i, 2.0 * j, heights[i, j]]
            found = least_squares(
                lambda p, w=wanted: at(p) - w, np.add(starts, ends) / 2, bounds=(starts, ends), **tight
            )
            np.testing.assert_allclose(at(found.x), wanted, atol=1e-6)
