"""Signed distances from surfaces of patches against projections of OCCT onto the same B-spline, at 10,000 poses."""

from typing import Any

import numpy as np
import pytest
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeVertex
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.GeomAPI import GeomAPI_ProjectPointOnSurf
from OCP.gp import gp_Pnt, gp_Vec
from scipy.spatial.transform import Rotation

from engine.mechanism.contacts import Contact
from tests.engine.cad.spline_shapes import spline_surface
from tests.engine.kernels.shapes import Poses, found
from tests.engine.kernels.surface_shapes import rational, wavy

Array = np.ndarray
POSES = 10_000
SPLINE = wavy()


def occt_surface() -> Any:
    """Return the B-spline as OCCT has it."""
    return spline_surface(SPLINE["control"], SPLINE["degree"], (SPLINE["knots_u"], SPLINE["knots_v"]))


def point_and_normal(surface: Any, u: float, v: float) -> tuple[Array, Array]:
    """Return a point of OCCT's surface and its normal there."""
    p, by_u, by_v = gp_Pnt(), gp_Vec(), gp_Vec()
    surface.D1(u, v, p, by_u, by_v)
    n = by_u.Crossed(by_v)
    n.Normalize()
    return np.array([p.X(), p.Y(), p.Z()]), np.array([n.X(), n.Y(), n.Z()])


def over(surface: Any, height: Array, rng: np.random.Generator) -> Array:
    """Return points at heights over random points of the surface that are not near its border."""
    feet = [point_and_normal(surface, *uv) for uv in rng.uniform(0.1, 0.9, (len(height), 2))]
    return np.array([p + h * n for (p, n), h in zip(feet, height, strict=True)])


def placed(q: Array, rng: np.random.Generator) -> Poses:
    """Return random poses of body b, and of body a, whose point is its origin, so that the point is q in b's frame."""
    n = len(q)
    R = Rotation.random(2 * n, random_state=rng).as_matrix().reshape(2, n, 3, 3)
    x = rng.normal(scale=3, size=(n, 3))
    return Poses((x + np.einsum("nij,nj->ni", R[1], q), x), (R[0], R[1]))


def contact(first: dict[str, Any]) -> Contact:
    """Return a contact of a side a with the surface."""
    return Contact.model_validate({"a": {"body": "a", **first}, "b": {"body": "b", "surface": SPLINE}, "friction": 0.1})


@pytest.mark.slow
def test_distance_sign_and_point_of_ten_thousand_poses():
    """Distance to 1e-10, and the same point and normal, from 1e-9 to 0.5 above the face and as near to 0.2 below it.

    Deeper points are nearer to the back of its plate.
    """
    rng, surface = np.random.default_rng(0), occt_surface()
    height = rng.choice([-0.4, 1], POSES) * 10 ** rng.uniform(-9, np.log10(0.5), POSES)
    q = over(surface, height, rng)
    poses = placed(q, rng)
    gap, point, frame = found(contact({"point": [0, 0, 0]}), poses)
    wanted, foot, normal = np.empty(POSES), np.empty((POSES, 3)), np.empty((POSES, 3))
    for k, p in enumerate(q):
        projection = GeomAPI_ProjectPointOnSurf(gp_Pnt(*p), surface)
        foot[k], normal[k] = point_and_normal(surface, *projection.LowerDistanceParameters())
        wanted[k] = np.copysign(projection.LowerDistance(), (p - foot[k]) @ normal[k])
    np.testing.assert_allclose(gap, wanted, rtol=0, atol=1e-10)
    assert np.all(np.sign(gap) == np.sign(wanted))
    seen = np.einsum("nji,nj->ni", poses.R[1], point - poses.x[1])
    np.testing.assert_allclose(seen, foot, atol=1e-9)
    np.testing.assert_allclose(np.einsum("nji,nj->ni", poses.R[1], frame[:, 0]), normal, atol=1e-8)
    ball = contact({"sphere": {"centre": [0, 0, 0], "radius": 0.25}})
    np.testing.assert_allclose(found(ball, poses)[0], wanted - 0.25, rtol=0, atol=1e-10)


def from_face(p: Array, face: Any) -> float:
    """Return OCCT's distance of a point from a face without a side or a back."""
    return float(BRepExtrema_DistShapeShape(BRepBuilderAPI_MakeVertex(gp_Pnt(*p)).Vertex(), face).Value())


@pytest.mark.parametrize("seed", [4, 13])
def test_a_sheet_with_unequal_weights_is_within_its_conversion_error(seed):
    """Over the face of a rational sheet the distance differs from OCCT's by no more than the patches may."""
    rng, conversion = np.random.default_rng(seed), 1e-4
    x, y = np.meshgrid([0.0, 5.0, 10.0], [0.0, 4.0, 8.0], indexing="ij")
    net, weights = np.stack([x, y, rng.normal(scale=0.8, size=(3, 3))], axis=-1), rng.uniform(0.5, 2.0, (3, 3))
    surface = spline_surface(net, (2, 2), ([0, 0, 0, 1, 1, 1],) * 2)
    for i, j in np.ndindex(3, 3):
        surface.SetWeight(i + 1, j + 1, float(weights[i, j]))
    side = rational(net, weights, conversion=conversion, depth=0.3)
    sheet = Contact.model_validate(
        {"a": {"body": "a", "point": [0, 0, 0]}, "b": {"body": "b", "surface": side}, "friction": 0.1}
    )
    q = over(surface, rng.uniform(1e-3, 0.5, 100), rng)
    gap, _, _ = found(sheet, placed(q, rng))
    wanted = [GeomAPI_ProjectPointOnSurf(gp_Pnt(*p), surface).LowerDistance() for p in q]
    np.testing.assert_allclose(gap, wanted, rtol=0, atol=conversion)


@pytest.mark.slow
def test_distance_beyond_the_border_is_that_of_the_face():
    """In front of the face and beside it the nearest point may be on an edge or at a corner."""
    rng, surface = np.random.default_rng(1), occt_surface()
    face = BRepBuilderAPI_MakeFace(surface, 1e-7).Face()
    q = rng.uniform([-2, -2, 0.7], [12, 10, 4], (1500, 3))
    poses = placed(q, rng)
    gap, point, _ = found(contact({"point": [0, 0, 0]}), poses)
    wanted = [from_face(p, face) for p in q]
    assert np.all(gap <= np.array(wanted) + 1e-7)
    nearer = np.abs(gap - wanted) >= 1e-7
    assert np.mean(nearer) < 0.01  # sides of the plate lean out where the border's normal leans in
    seen = np.einsum("nji,nj->ni", poses.R[1], point - poses.x[1])
    beside = [from_face(each, face) for each in seen[nearer]]
    assert all(far > 1e-4 for far in beside)  # and there it is the side that is nearest


@pytest.mark.slow
def test_an_arc_by_many_projections():
    """A circle over the face: the least of OCCT's distances along it, from a grid refined about its least value."""
    rng, surface = np.random.default_rng(2), occt_surface()
    q = over(surface, rng.uniform(0.6, 1.5, 40), rng)
    poses = placed(q, rng)
    gap, _, _ = found(contact({"arc": {"centre": [0, 0, 0], "normal": [0, 0, 1], "radius": 0.5}}), poses)
    turn = np.einsum("nji,njk->nik", poses.R[1], poses.R[0])
    for k in range(len(q)):
        grid, width = np.linspace(-np.pi, np.pi, 73), 2 * np.pi / 72
        for _ in range(8):
            on = q[k] + 0.5 * np.stack([np.cos(grid), np.sin(grid), 0 * grid], axis=-1) @ turn[k].T
            far = [GeomAPI_ProjectPointOnSurf(gp_Pnt(*p), surface).LowerDistance() for p in on]
            best = grid[int(np.argmin(far))]
            grid, width = np.linspace(best - width, best + width, 9), width / 4
        assert gap[k] == pytest.approx(min(far), abs=1e-7)
