"""The plane on which a mechanism is drawn."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clearcap.pictures.view import choose_view
from engine import load_mechanism
from tests.engine.small import block_on_floor, made, shipped, turned

X, Y, Z = np.eye(3)


@pytest.mark.parametrize(("name", "right", "up"), [("clearance_pendulum", X, Y), ("c60", X, Y), ("incline", X, Z)])
def test_plane_of_the_shipped_mechanisms(name, right, up):
    """Along the joints' axes; without joints across gravity and the planes' normals. Exactly, where it is an axis."""
    view = choose_view(load_mechanism(name))
    np.testing.assert_array_equal([view.right, view.up], [right, up])
    np.testing.assert_array_equal(np.cross(view.right, view.up), view.normal)


def test_plane_turns_with_the_mechanism():
    """A turned pendulum is seen along its axis, up against its gravity; the picture is the same or its mirror."""
    rotation = Rotation.from_rotvec([0.4, -1.1, 0.7])
    view = choose_view(made(turned(shipped("clearance_pendulum"), rotation, np.zeros(3))))
    assert abs(view.normal @ rotation.apply(Z)) == pytest.approx(1)
    np.testing.assert_allclose(view.up, rotation.apply(Y), atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm([view.right, view.up, view.normal], axis=1), 1)


def test_plane_without_any_hint():
    """A brick above a level floor is seen from the front; without gravity and planes along z."""
    data = block_on_floor(origin=[0, 0, 0.5])
    np.testing.assert_array_equal(choose_view(made(data)).up, Z)
    del data["contacts"], data["gravity"]
    np.testing.assert_array_equal(choose_view(made(data)).normal, Z)


def test_projection():
    """Points and vectors of any shape lose what is along the line of sight."""
    view = choose_view(load_mechanism("incline"))
    np.testing.assert_array_equal(view.project(np.array([[[1.0, 2.0, 3.0]]])), [[[1.0, 3.0]]])
