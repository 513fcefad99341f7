"""The shape of a body, and its outline."""

import numpy as np
import pytest

from clearcap.pictures.shapes import body_shape, hull
from clearcap.pictures.view import choose_view
from engine import load_mechanism
from tests.engine.small import made, shipped


def test_outline():
    """The convex hull in order; two ends of a line; one point; nothing."""
    corners = np.array([[0, 0], [2, 0], [1, 1], [2, 2], [0, 2.0]])
    assert sorted(hull(corners)) == [0, 1, 3, 4]
    line = np.linspace(0, 1, 5)[:, None] * [[3, 4]]
    assert sorted(hull(line)) == [0, 4]
    assert hull(np.zeros((1, 2))) == [0]
    assert hull(np.zeros((0, 2))) == []


def test_outline_of_the_file_comes_first():
    """In place of the hull; then of contact primitives only working faces are drawn: arcs and rectangles."""
    data = shipped("clearance_pendulum")
    corners = [[0.0, 0.0], [0.1, -0.1], [0.0, -0.2, 0.01]]
    link = body_shape(made(data), "link", choose_view(made(data)), {}, 1.0)
    assert len(link.outline) > 3
    data["bodies"]["link"]["outline"] = corners
    drawn = body_shape(made(data), "link", choose_view(made(data)), {}, 1.0)
    np.testing.assert_array_equal(drawn.outline, [[0, 0, 0], [0.1, -0.1, 0], [0, -0.2, 0.01]])
    assert len(drawn.lines) == len(link.lines) == 1  # its bore
    mechanism = load_mechanism("c60")
    touched = {name: np.zeros((1, 3)) for name in mechanism.contacts}
    contact = body_shape(mechanism, "moving_contact", choose_view(mechanism), touched, 1.0)
    assert all(np.ptp(line, axis=0).max() < 5 for line in contact.lines)  # not the whole cylinder of C7, 10.4 wide


@pytest.mark.parametrize(
    "solid",
    [
        {"capsule": {"point": [0, 0, 0], "axis": [1, 0, 0], "radius": 0.1, "half_length": 0.2}},
        {"box": {"centre": [0, 0, 0], "half_lengths": [0.3, 0.1, 0.1]}},
        {"mesh": {"pieces": [[[-0.3, 0, 0], [0.3, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]]}},
    ],
)
def test_a_solid_is_drawn_as_long_as_it_is(solid):
    data = shipped("clearance_pendulum")
    data["contacts"] = {
        "lies": {
            "a": {"body": "link", **solid},
            "b": {"body": next(iter(data["bodies"])), "plane": {"point": [0, 0, -9], "normal": [0, 0, 1]}},
            "friction": 0.1,
        }
    }
    mechanism = made(data)
    shape = body_shape(mechanism, "link", choose_view(mechanism), {"lies": np.zeros((1, 3))}, 1.0)
    assert np.ptp(np.vstack(shape.lines), axis=0).max() == pytest.approx(0.6)
