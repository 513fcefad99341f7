"""Triangles of parts: closed, turned outwards, and as near to the faces as they say."""

import numpy as np
import pytest
from OCP.BRepPrimAPI import BRepPrimAPI_MakeSphere, BRepPrimAPI_MakeTorus
from OCP.gp import gp_Pnt

from tests.engine.cad import latch
from tests.engine.cad.step_files import Drawing, place


def volume_of(mesh):
    """Return the volume that triangles enclose, by the divergence theorem."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles].astype(float), 1, 0)
    return float(np.einsum("nk,nk->", a, np.cross(b, c))) / 6


def test_volumes_of_the_latch(read):
    """The volume is the solid's, up to the deflection on all of its surface."""
    assembly = read(latch.drawing())
    for part, mesh in zip(assembly.parts, assembly.meshes, strict=True):
        area = sum(face.area for face in assembly.faces_of(part.name))
        off = abs(volume_of(mesh) - part.solids[0].volume)
        assert 0 < mesh.deflection <= 0.05
        assert off <= mesh.deflection * area
        assert off <= 2e-3 * part.solids[0].volume
        corners = mesh.vertices[mesh.triangles]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        assert areas.sum() == pytest.approx(area, rel=0.01)


@pytest.mark.parametrize("size", [0.1, 3.0, 40.0])
def test_distance_to_a_ball_and_a_torus(read, size):
    """Vertices lie on the faces, the middles of triangles within twice the deflection."""
    made = Drawing()
    top = made.assembly("top")
    shapes = BRepPrimAPI_MakeSphere(gp_Pnt(), size).Shape(), BRepPrimAPI_MakeTorus(2 * size, size / 2).Shape()
    for name, shape in zip(("ball", "ring"), shapes, strict=True):
        made.add(top, made.product(name, shape), place())
    ball, ring = read(made).meshes
    for mesh, off in (
        (ball, lambda p: np.linalg.norm(p, axis=1) - size),
        (ring, lambda p: np.hypot(np.hypot(p[:, 0], p[:, 1]) - 2 * size, p[:, 2]) - size / 2),
    ):
        assert np.abs(off(mesh.vertices)).max() < 1e-6 * size
        assert np.abs(off(mesh.vertices[mesh.triangles].mean(axis=1))).max() <= 2 * mesh.deflection
