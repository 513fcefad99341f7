"""Turned and extruded solids against OCCT: the distance from its faces, and what it says is inside.

Its solids are made from the profile as the file has it, by its own turning and extruding.
"""

import math
from typing import Any

import numpy as np
import pytest
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakeVertex,
    BRepBuilderAPI_MakeWire,
)
from OCP.BRepClass3d import BRepClass3d_SolidClassifier
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism, BRepPrimAPI_MakeRevol
from OCP.gp import gp_Ax1, gp_Ax2, gp_Circ, gp_Dir, gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_IN, TopAbs_SHELL
from OCP.TopExp import TopExp_Explorer

from engine.mechanism.contacts import Contact
from tests.engine.kernels.profile_shapes import pieces, spanned
from tests.engine.kernels.shapes import Poses, drawn, found, scattered

SOLIDS = 10  # of each kind
POSES = 1000  # of each of them: 10,000 of a kind
CLOSE = 1e-10  # mm


def edge(start: Any, end: Any, centre: Any, way: int, place: Any) -> Any:
    """Return a line or an arc in the plane that ``place`` puts into space; the plane's normal is z or -y."""
    if centre is None:
        return BRepBuilderAPI_MakeEdge(place(start), place(end)).Edge()
    up = place([0, 1]).Z() == 1
    normal = gp_Dir(0, -way, 0) if up else gp_Dir(0, 0, way)
    radius, first, _ = spanned(start, end, centre, way)
    out = [math.cos(first), math.sin(first)]
    there, here = place(out), place([0, 0])
    circle = gp_Circ(gp_Ax2(place(centre), normal, gp_Dir(gp_Vec(here, there))), radius)
    if np.all(start == end):
        return BRepBuilderAPI_MakeEdge(circle).Edge()
    return BRepBuilderAPI_MakeEdge(circle, place(start), place(end)).Edge()


def solid(side: Any) -> Any:
    """Return a turned or an extruded primitive as a solid of OCCT, in the axes of its profile."""
    shape, wire = side.primitive, BRepBuilderAPI_MakeWire()
    upright = side.kind == "turned"
    half = 0.0 if upright else shape.half_length or 50.0

    def place(p: Any) -> gp_Pnt:
        return gp_Pnt(p[0], 0.0, p[1]) if upright else gp_Pnt(p[0], p[1], -half)

    for piece in pieces(shape.start, shape.profile):
        wire.Add(edge(*piece, place))
    face = BRepBuilderAPI_MakeFace(wire.Wire(), True).Face()
    if upright:
        return BRepPrimAPI_MakeRevol(face, gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1))).Shape()
    return BRepPrimAPI_MakePrism(face, gp_Vec(0, 0, 2 * half)).Shape()


def signed_distance(body: Any, p: np.ndarray) -> float:
    """Return OCCT's distance of a point from the solid's surface, negative where it says that the point is inside."""
    at = gp_Pnt(*map(float, p))
    shell = TopExp_Explorer(body, TopAbs_SHELL).Current()
    nearest = BRepExtrema_DistShapeShape(BRepBuilderAPI_MakeVertex(at).Vertex(), shell)
    state = BRepClass3d_SolidClassifier(body, at, 1e-13).State()
    return float(nearest.Value()) * (-1 if state == TopAbs_IN else 1)


def near_contact(contact: Contact, poses: Poses, rng: np.random.Generator) -> Poses:
    """Return the poses with side a moved along the normal to 1e-4 to 0.1 mm from b's surface, outside or inside.

    OCCT lets a face go on for 1e-7 mm beyond its edge: nearer to the edge its distances are off by more than 1e-10 mm.
    """
    gap, _, frame = found(contact, poses)
    height = 10 ** rng.uniform(-4, -1, len(poses)) * rng.choice([-1, 1], len(poses))
    shift = (height - gap - contact.offset)[:, None] * frame[:, 0]
    return Poses((poses.x[0] + shift, poses.x[1]), poses.R)


def in_solid(contact: Contact, poses: Poses) -> np.ndarray:
    """Return the point of side a in the axes in which `solid` is made, shape (n, 3); a turned one may lie anyhow."""
    shape = contact.sides[1].primitive
    w = poses.seen(np.asarray(contact.sides[0].primitive)) - shape.point
    z = np.array(shape.axis)
    x = np.array(getattr(shape, "along", None) or np.cross(z, np.eye(3)[np.argmin(np.abs(z))]))
    x = x / np.linalg.norm(x)
    return np.stack([w @ x, w @ np.cross(z, x), w @ z], axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["turned", "extruded"])
def test_distance_and_sign_are_those_of_occt(kind):
    """10,000 poses of a kind, half of them within 0.1 mm of contact, on both sides of it."""
    rng = np.random.default_rng(17)
    inside = 0
    for _ in range(SOLIDS):
        contact = drawn(f"point-{kind}", rng)
        far, near = scattered(POSES // 2, rng, 0.7), near_contact(contact, scattered(POSES // 2, rng, 0.7), rng)
        body = solid(contact.sides[1])
        for poses in (far, near):
            gap = found(contact, poses)[0] + contact.offset
            theirs = np.array([signed_distance(body, p) for p in in_solid(contact, poses)])
            np.testing.assert_allclose(gap, theirs, rtol=0, atol=CLOSE)
            told_apart = np.abs(theirs) > CLOSE
            assert np.all(np.sign(gap[told_apart]) == np.sign(theirs[told_apart]))
            inside += np.sum(theirs < -CLOSE)
    assert inside > 0.2 * SOLIDS * POSES
