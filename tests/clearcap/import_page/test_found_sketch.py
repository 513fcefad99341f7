"""The drawing of what was found: names of the mechanism file, places and radii to scale."""

from dataclasses import replace

import numpy as np
import pytest

from clearcap.import_page import MOST_NAMED, place_lines, sketch_found, view_of
from clearcap.pictures.style import FORCE, INK
from engine.cad_import.found_features import found_features
from tests.clearcap.import_page.conftest import latch  # noqa: F401
from tests.engine.cad.latch import CRANK, RADII, ROCKER, ROCKER_FOOT

pytestmark = pytest.mark.processes

MIDDLES = {"base-crank": (0.0, 0.0), "crank-coupler": CRANK, "rocker-coupler": ROCKER, "base-rocker": ROCKER_FOOT}
NAMES = ["base-crank", "base-rocker", "crank-coupler", "rocker-coupler", "stop-1"]


@pytest.fixture
def places(latch):  # noqa: F811
    return found_features(latch)


@pytest.fixture
def sketch(latch, places):  # noqa: F811
    return sketch_found(latch, places)


def test_it_is_seen_along_the_pins(latch):  # noqa: F811
    """The axis x is to the right, y upwards."""
    view = view_of(latch)
    np.testing.assert_allclose([view.right, view.up, view.normal], np.eye(3), atol=1e-12)


def test_joints_are_to_scale(sketch):
    """Dots are where the drawing script put the pins, circles have the radii of the holes."""
    dots = {name: np.array([x, -y]) for name, (x, y, colour) in zip(NAMES, sketch.dots, strict=True)}
    joints = {name: dots[name] for name in MIDDLES}
    scale = np.linalg.norm(joints["base-rocker"] - joints["base-crank"]) / 50.0
    for name, place in MIDDLES.items():
        np.testing.assert_allclose((joints[name] - joints["base-crank"]) / scale, place, atol=0.1 / scale)
    circles = [np.array(stroke.points) for stroke in sketch.strokes if len(stroke.points) > 20]
    found = sorted(float(np.ptp(circle, axis=0).max()) / 2 / scale for circle in circles)
    holes = sorted(2 * [hole for _, hole in RADII.values()])
    assert found == pytest.approx(holes, abs=0.1 / scale)


def test_names_and_colours(sketch, places):
    """Each place is named once, with its radii; stops have a colour of their own, and all are explained beside."""
    words = {word.lines[0]: word for word in sketch.words}
    assert {place.name for place in places} | {"base", "crank", "rocker", "coupler"} == words.keys()
    assert words["base-crank"].lines == ("base-crank", "radii 3.05 and 3")
    assert {words["stop-1"].colour, words["base-crank"].colour} == {FORCE, INK}
    assert [row[0] for row in sketch.legend] == NAMES
    assert [colour for _, colour in sketch.areas] == [words[word.lines[0]].colour for word in sketch.words[-4:]]


def test_lines_of_a_joint_that_lies_across(places):
    """Circles at both ends of the hole, and an axis that is longer by two radii."""
    joint = places[0]
    first, second, axis = place_lines(joint)
    for circle, end in zip((first, second), joint.ends, strict=True):
        np.testing.assert_allclose(np.linalg.norm(circle - end, axis=1), joint.radius, rtol=1e-12)
    long = np.linalg.norm(axis[1] - axis[0])
    assert long == pytest.approx(np.linalg.norm(joint.ends[1] - joint.ends[0]) + 2 * joint.radius)


def test_a_hundred_candidates(latch, places):  # noqa: F811
    """No more are named than the drawing has room for, and how many are left out is said."""
    many = [*places[:4], *(replace(places[4], name=f"stop-{number}") for number in range(1, 101))]
    sketch = sketch_found(latch, many)
    assert len(sketch.legend) == MOST_NAMED + 1
    assert sketch.legend[-1][0] == f"and {104 - MOST_NAMED} more"
    assert all(-1e-9 <= x <= sketch.width for word in sketch.words for x in (word.x,))


def test_many_parts(latch, places, monkeypatch):  # noqa: F811
    """The largest ones are drawn, and how many are left out is said."""
    monkeypatch.setattr("clearcap.import_page.MOST_DRAWN", 3)
    sketch = sketch_found(latch, places)
    assert len(sketch.areas) == 3
    assert "crank" not in {word.lines[0] for word in sketch.words}
    assert sketch.legend[-1][:2] == ("not drawn", "the smallest parts: 1")


def test_a_ball_is_three_circles(latch, places):  # noqa: F811
    """A ball in its socket has no axis: circles about its centre with the socket's radius, also where it is alone."""
    ball = replace(places[0], ends=np.array([[1.0, 2.0, 3.0]] * 2), radius=4.0)
    lines = place_lines(ball)
    assert len(lines) == 3
    for line in lines:
        np.testing.assert_allclose(np.linalg.norm(line - ball.middle, axis=1), 4.0, atol=1e-12)
    alone = sketch_found(replace(latch, joints=(), stops=()), [ball])
    assert len(alone.dots) == 1
