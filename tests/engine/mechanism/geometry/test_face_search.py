"""Distances by which faces and edges are found, against brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.cad import CadEdge
from engine.cad.geometry import distance_to_triangles
from engine.mechanism.geometry.drawn_features import _to_arc

pytestmark = pytest.mark.processes

NUMBERS = st.floats(-3, 3, allow_nan=False).map(lambda x: round(x, 3))
POINTS = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(np.array)


@given(POINTS, st.lists(POINTS, min_size=3, max_size=3))
def test_distance_to_a_triangle(point, corners):
    """The nearest of many points of the triangle is hardly farther, and none is nearer."""
    corners = np.array(corners)
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, 101)])
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = corners[0] + u[..., None] * (corners[1] - corners[0]) + v[..., None] * (corners[2] - corners[0])
    nearest = np.linalg.norm(points - point, axis=-1).min()
    distance = distance_to_triangles(point, corners[None])
    assert distance <= nearest + 1e-9
    assert nearest - distance <= 0.1


def test_no_triangles():
    """Nothing is infinitely far away."""
    assert distance_to_triangles(np.zeros(3), np.zeros((0, 3, 3))) == np.inf


@given(POINTS, st.floats(0.1, 2 * np.pi))
def test_distance_to_an_arc(point, span):
    """The same for arcs and whole circles."""
    whole = span > 6.2
    middle = np.zeros(3) if whole else np.array([0.0, 1.0, 0.0])
    span = 2 * np.pi if whole else span
    axis = np.array([1.0, 0.0, 0.0])
    edge = CadEdge(part="p", faces=(0,), centre=np.zeros(3), axis=axis, radius=2.0, span=span, middle=middle)
    angles = np.pi / 2 + np.linspace(-span / 2, span / 2, 2001)
    points = 2.0 * np.column_stack([0 * angles, np.sin(angles), np.cos(angles + np.pi)])
    nearest = np.linalg.norm(points - point, axis=1).min()
    assert _to_arc(edge, point) == pytest.approx(nearest, abs=4e-3)
