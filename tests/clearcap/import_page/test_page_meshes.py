"""Triangles for a page: those of the parts, or fewer of the same shape."""

from itertools import chain

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from clearcap.import_page import coarser, page_meshes
from engine.cad.cad_model import TriangleMesh
from tests.engine.cad.occt.test_triangulation import volume_of


def ball(rings, radius=10.0, deflection=0.01):
    """Return a closed ball of 2 rings (rings - 1) triangles, its upper half another face."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, rings + 1), indexing="ij")
    points = radius * np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1)
    places = np.arange((rings + 1) ** 2).reshape(rings + 1, -1)
    a, b, c, d = (x.ravel() for x in (places[:-1, :-1], places[1:, :-1], places[1:, 1:], places[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], 1)[: -rings or None], np.stack([a, c, d], 1)[rings:]])
    vertices = points.reshape(-1, 3)
    low = vertices[triangles].mean(axis=1)[:, 2] < 0
    # each face has vertices of its own, as OCCT makes them
    own = np.where(low[:, None], triangles + len(vertices), triangles)
    return TriangleMesh(
        part="ball", vertices=np.concatenate([vertices, vertices]), triangles=own, faces=low + 7, deflection=deflection
    )


def open_edges(mesh):
    """Return the sides of triangles, by the places of their ends, that no neighbour has the other way round."""
    ends = np.round(mesh.vertices, 9) + 0.0
    corners = [[tuple(ends[vertex]) for vertex in row] for row in mesh.triangles]
    sides = list(chain.from_iterable(zip(row, row[1:] + row[:1], strict=True) for row in corners))
    left = {}
    for a, b in sides:
        left[a, b] = left.get((a, b), 0) + 1
        left[b, a] = left.get((b, a), 0) - 1
    return [side for side, count in left.items() if count]


def test_few_triangles_stay_as_they_are():
    """Only sorted by faces, in single precision, from the centre."""
    mesh, centre = ball(24), np.array([1e5, 2.0, -3.0])
    far = TriangleMesh(part="x", vertices=mesh.vertices + centre, triangles=mesh.triangles, faces=mesh.faces)
    [page], deviation = page_meshes([far], centre, most=10_000)
    assert deviation == 0.0
    assert volume_of(page) == pytest.approx(volume_of(mesh), rel=1e-6)
    assert len(page.triangles) == len(mesh.triangles)
    assert page.stretches.keys() == {7, 8}
    for number, (first, count) in page.stretches.items():
        heights = page.vertices[page.triangles[first : first + count]].mean(axis=1)[:, 2]
        assert ((heights < 0) == (number == 8)).all()
        assert count == np.count_nonzero(mesh.faces == number)


@settings(max_examples=30, deadline=None)
@given(cell=st.floats(0.05, 8.0), rings=st.integers(6, 20))
def test_coarser(cell, rings):
    """No vertex moves farther than a cell's diagonal, none is lost, and what was closed stays so."""
    mesh = ball(rings)
    assert open_edges(mesh) == []
    less, moved = coarser(mesh, cell)
    assert moved <= np.sqrt(3.0) * cell
    assert len(less.triangles) <= len(mesh.triangles)
    used = less.vertices[np.unique(less.triangles)].reshape(-1, 3)
    if len(used):
        assert KDTree(mesh.vertices).query(used)[0].max() <= moved + 1e-12
    assert open_edges(less) == []
    assert set(less.faces) <= {7, 8}


def test_many_triangles_become_fewer():
    """Together they are at most as many as allowed, and within the stated deviation."""
    meshes = [ball(120), ball(60, radius=2.0, deflection=0.002)]
    pages, deviation = page_meshes(meshes, np.zeros(3), most=5000)
    assert 1000 < sum(len(page.triangles) for page in pages) <= 5000
    assert 0.01 < deviation < 1.0
    for page, mesh, radius in zip(pages, meshes, (10.0, 2.0), strict=True):
        off = np.abs(np.linalg.norm(page.vertices, axis=1) - radius)
        assert off.max() <= deviation
        assert abs(volume_of(page) - volume_of(mesh)) <= deviation * 4 * np.pi * radius**2


@pytest.mark.parametrize("most", [0, 3])
def test_almost_nothing_is_left(most):
    """It ends, even where no triangle is allowed."""
    [page], _ = page_meshes([ball(8)], np.zeros(3), most=most)
    assert len(page.triangles) <= most


def test_nothing():
    """A part without triangles, and no parts."""
    empty = TriangleMesh(part="x", vertices=np.zeros((0, 3)))
    [page], deviation = page_meshes([empty], np.zeros(3), most=10)
    assert (len(page.triangles), page.stretches, deviation) == (0, {}, 0.0)
    assert page_meshes([], np.zeros(3), most=10) == ([], 0.0)
    assert coarser(empty, 1.0) == (empty, 0.0)
