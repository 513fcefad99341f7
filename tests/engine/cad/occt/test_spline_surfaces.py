"""B-splines that cover faces: their areas, their normals and where they are, against the faces themselves."""

from math import cos, pi, sin, tau

import numpy as np
import pytest
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeVertex
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.BRepFilletAPI import BRepFilletAPI_MakeFillet
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeSphere, BRepPrimAPI_MakeTorus
from OCP.collections import Array2_gp_Pnt
from OCP.Geom import Geom_CylindricalSurface, Geom_OffsetSurface
from OCP.GeomAPI import GeomAPI_PointsToBSplineSurface
from OCP.gp import gp_Ax2, gp_Ax3, gp_Dir, gp_Pnt
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS
from scipy.interpolate import BSpline

from engine.cad.occt import spline_surfaces
from engine.cad.occt.occt_values import OCCT_ERRORS
from tests.each import each
from tests.engine.cad.step_files import Drawing, box, cone, cut, cylinder, fused, mirrored, one_face_a_plane, place

GAUSS, WEIGHTS = np.polynomial.legendre.leggauss(12)


def drawing(shape, **where):
    """Return a drawing with one part, at the origin or at a place."""
    drawn = Drawing()
    whole = drawn.assembly("whole")
    drawn.add(whole, drawn.product("part", shape), place(**where) if where else None)
    return drawn


def ball(radius, *angles):
    """Return a ball, or the part of one between latitudes and up to a longitude."""
    return BRepPrimAPI_MakeSphere(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), radius, *angles).Shape()


def ring(radius, tube, *angles):
    """Return a torus, or a part of one."""
    return BRepPrimAPI_MakeTorus(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), radius, tube, *angles).Shape()


def with_fillets(shape, radius):
    """Return a shape with all its edges rounded."""
    made, edges = BRepFilletAPI_MakeFillet(shape), TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_EDGE)
    while edges.More():
        made.Add(radius, TopoDS.Edge(edges.Current()))
        edges.Next()
    return made.Shape()


def on_knots(spline):
    """Return parameters and weights with which a function of the surface is integrated, for u and for v."""
    for axis in (0, 1):
        p = spline.degrees[axis]
        cuts = np.unique(spline.knots[axis][p : len(spline.knots[axis]) - p])
        half = np.diff(cuts)[:, None] / 2
        yield ((cuts[:-1, None] + half) + half * GAUSS).ravel(), (half * WEIGHTS).ravel()


def evaluated(spline, u, v, by_u=0, by_v=0):
    """Return the homogeneous points of a surface on a grid of parameters, or derivatives, shape (n, m, 4)."""
    w = spline.weights[..., None]
    net = np.concatenate([spline.points * w, w], axis=-1)
    along = BSpline(spline.knots[0], net, spline.degrees[0])(u, by_u)
    return np.moveaxis(BSpline(spline.knots[1], np.moveaxis(along, 1, 0), spline.degrees[1])(v, by_v), 0, 1)


def points_and_products(spline, u, v):
    """Return points of a surface on a grid of parameters, and the vector products S_u x S_v."""
    A, A_u, A_v = (evaluated(spline, u, v, *by) for by in ((0, 0), (1, 0), (0, 1)))
    S = A[..., :3] / A[..., 3:]
    S_u, S_v = ((D[..., :3] - S * D[..., 3:]) / A[..., 3:] for D in (A_u, A_v))
    return S, np.cross(S_u, S_v)


def area(spline):
    """Return the area of a surface."""
    (u, du), (v, dv) = on_knots(spline)
    return float(du @ np.linalg.norm(points_and_products(spline, u, v)[1], axis=-1) @ dv)


def distance_from(shape, points):
    """Return the largest distance of points from a shape, by OCCT."""
    vertices = [BRepBuilderAPI_MakeVertex(gp_Pnt(*map(float, point))).Vertex() for point in points.reshape(-1, 3)]
    return max(BRepExtrema_DistShapeShape(vertex, shape).Value() for vertex in vertices)


def normal_at(spline, point):
    """Return the unit normal of a surface near a point of it, and how far away, from a dense grid."""
    ends = [(k[p], k[len(k) - p - 1]) for k, p in zip(spline.knots, spline.degrees, strict=True)]
    S, n = points_and_products(spline, *(np.linspace(low, high, 101)[1:-1] for low, high in ends))
    far = np.linalg.norm(S - point, axis=-1)
    at = np.unravel_index(far.argmin(), far.shape)
    return n[at] / np.linalg.norm(n[at]), far[at]


SHAPES = {
    "box": (box((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)), 6),
    "cylinder": (cylinder((1.0, 0.0, 0.0), 3.0, 4.0), 1),
    "hole": (cut(box((-5.0, -5.0, 0.0), (10.0, 10.0, 4.0)), cylinder((0.0, 0.0, -1.0), 3.0, 6.0)), 5),
    "cone": (cone((0.0, 0.0, 0.0), (3.0, 1.0), 4.0), 1),
    "pointed cone": (cone((0.0, 0.0, 0.0), (3.0, 0.0), 4.0), 1),
    "ball": (ball(3.0), 1),
    "orange slice": (ball(3.0, 0.0, pi / 2, pi / 3), 1),
    "torus": (ring(5.0, 2.0), 1),
    "part of a torus": (ring(5.0, 2.0, pi / 2), 1),
    "rounded box": (with_fillets(box((0.0, 0.0, 0.0), (6.0, 5.0, 4.0)), 1.0), 6 + 12 + 8),
    "corner step": (cut(box((0.0, 0.0, 0.0), (6.0, 6.0, 2.0)), box((3.0, 3.0, -1.0), (4.0, 4.0, 4.0))), 8),
    "window": (cut(box((0.0, 0.0, 0.0), (6.0, 6.0, 2.0)), box((2.0, 2.0, -1.0), (1.0, 3.0, 4.0))), 10),
    "boss": (one_face_a_plane(fused(box((0.0, 0.0, 0.0), (9.0, 4.0, 2.0)), box((5.0, 1.0, 2.0), (2.0, 2.0, 2.0)))), 11),
}


@pytest.mark.slow
@each("turned", [False, True])
@each("name", list(SHAPES))
def test_they_cover_the_face_and_nothing_else(read, name, turned):
    """Areas agree, all points are on the shape, and normals point out; also those of its mirror image in space."""
    shape, count = SHAPES[name]
    shape = mirrored(shape, (0.6, 0.0, 0.8)) if turned else shape
    found = [face for face in read(drawing(shape)).faces if face.splines]
    assert len(found) == count
    for face in found:
        assert sum(map(area, face.splines)) == pytest.approx(face.area, rel=1e-6)
        for spline in face.splines:
            S, _ = points_and_products(spline, *(np.linspace(k[0], k[-1], 4) for k in spline.knots))
            assert distance_from(shape, S) < 1e-9
        normal, _ = min((normal_at(spline, face.on) for spline in face.splines), key=lambda each: each[1])
        assert normal @ face.normal > 0.9


def test_an_instance_and_its_mirror_image(read):
    """Both instances of a product have normals out of their material, wherever they stand."""
    drawn = Drawing()
    whole = drawn.assembly("whole")
    block = drawn.product("block", SHAPES["rounded box"][0])
    drawn.add(whole, block, place(x=30.0, angle=0.7))
    flip = place()
    flip.SetMirror(Drawing.plane((1.0, 2.0, 3.0), (0.0, 0.6, 0.8)))
    drawn.add(whole, block, flip)
    assembly = read(drawn)
    assert [part.placement.mirrored for part in assembly.parts] == [False, True]
    for part in assembly.parts:
        middle = part.bounds.mean(axis=0)
        for face in assembly.faces_of(part.name):
            [spline] = face.splines
            S, n = points_and_products(spline, *(np.linspace(k[0], k[-1], 5)[1:-1] for k in spline.knots))
            assert np.all(np.sum((S - middle) * n, axis=-1) > 0)


def test_faces_across_parameter_lines_have_none(read):
    """The round ends of a cylinder, and a cylinder that is cut off at an angle."""
    faces = read(drawing(cylinder((0.0, 0.0, 0.0), 3.0, 4.0))).faces
    assert [face.kind for face in faces if not face.splines] == ["plane", "plane"]
    tilted = gp_Ax2(gp_Pnt(-10.0, -10.0, 0.0), gp_Dir(0.0, -sin(0.3), cos(0.3)), gp_Dir(1.0, 0.0, 0.0))
    slope = cut(cylinder((0.0, 0.0, 0.0), 3.0, 4.0), BRepPrimAPI_MakeBox(tilted, 20.0, 20.0, 20.0).Shape())
    assert [face.kind for face in read(drawing(slope)).faces if face.splines] == []


def test_an_offset_surface_has_none(read):
    """The offset of a spline is no spline."""
    heights = Array2_gp_Pnt(1, 6, 1, 6)
    for i in range(6):
        for j in range(6):
            heights.SetValue(i + 1, j + 1, gp_Pnt(2.0 * i, 2.0 * j, 0.1 * sin(i) * cos(j)))
    base = GeomAPI_PointsToBSplineSurface()
    base.Interpolate(heights)
    offset = Geom_OffsetSurface(base.Surface(), 0.3)
    [face] = read(drawing(BRepBuilderAPI_MakeFace(offset, 1e-6).Face())).faces
    assert (face.kind, face.splines) == ("surface", ())


def test_a_turn_that_is_longer_than_its_period():
    """By what a CAD system rounds: it is one period, and can be converted."""
    within = spline_surfaces._within
    assert within(np.array([-4.1e-13, tau]), (0.0, tau), True) == [0.0, tau]
    assert within(np.array([1.0, 1.0 + tau + 1e-12]), (0.0, tau), True) == [1.0, 1.0 + tau]
    assert within(np.array([-4.1e-13, 2.0]), (0.0, 1.0), False) == [0.0, 1.0]
    surface = Geom_CylindricalSurface(gp_Ax3(), 3.0)
    spline = spline_surfaces._spline(surface, ((0.0, tau), (0.0, 4.0)))
    assert area(spline) == pytest.approx(tau * 3.0 * 4.0)
    with pytest.raises(OCCT_ERRORS):
        spline_surfaces._spline(surface, ((-4.1e-13, tau), (0.0, 4.0)))
