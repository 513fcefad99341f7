"""Runs on faces of CAD parts, in closed form: where a ball rests in a bowl, and how far a cam lifts its follower."""

from math import cos, pi, sin, tan

import numpy as np
import pytest
import tomli_w

from engine import load_mechanism, read_trajectory, simulate
from tests.engine.cad.spline_shapes import elliptic_cam, parabolic_bowl
from tests.engine.mechanism.geometry.surface_files import one_part, surface_file, written

pytestmark = pytest.mark.processes

TILT, RADIUS, BALL = 0.25, 10.0, 1.5


def loaded(folder, drawing, surface, changes):
    """Return the mechanism of a drawing, a surface and changed tables."""
    data = surface_file(written(drawing, folder), surface)
    for table, entries in changes.items():
        data[table] = {**data.get(table, {}), **entries} if isinstance(entries, dict) else entries
    path = folder / "faces.toml"
    path.write_text(tomli_w.dumps(data))
    return load_mechanism(path)


def height(axis):
    """Measure a coordinate of the probe."""
    vector = np.eye(3)["xyz".index(axis)].tolist()
    ends = {"from": {"body": "block", "point": [0, 0, 0]}, "to": {"body": "probe", "point": [0, 0, 0]}}
    return {"type": "position", "direction": {"vector": vector}, **ends}


@pytest.mark.slow
def test_a_ball_rests_where_gravity_is_normal_to_the_bowl(tmp_path):
    """A paraboloid under tilted gravity: the foot of the ball is where the slope is the tilt, to 1e-6 mm."""
    gravity = [0.00981 * sin(TILT), 0.0, -0.00981 * cos(TILT)]
    start = {"mass": 1.0, "inertia": [0.9] * 3, "origin": [0.5, 0.3, BALL + 0.05]}
    ball = {"sphere": {"centre": [0.0, 0.0, 0.0], "radius": BALL}}
    changes = {
        "gravity": gravity,
        "bodies": {"probe": start},
        "contacts": {
            "touch": {
                "a": {"body": "probe", **ball},
                "b": {"body": "block", "surface": {"faces": [{"near": [0.0, 0.0, 0.0]}], "depth": 2.0}},
                "friction": 0.0,
            }
        },
        "phases": [{"name": "settle", "duration": 6000.0, "damping": 0.02}],
        "simulation": {"step": 2.0, "penetration": 1e-8, "horizon": 6000.0, "rest": {"window": 200.0, "drift": 1e-10}},
        "responses": {axis: height(axis) for axis in "xyz"},
    }
    run = simulate(loaded(tmp_path, one_part(parabolic_bowl(RADIUS)), {}, changes))
    assert run.status == "ok", run.message
    foot = RADIUS * tan(TILT)
    wanted = [foot + BALL * -sin(TILT), 0.0, foot**2 / (2 * RADIUS) + BALL * cos(TILT)]
    np.testing.assert_allclose([run.responses[axis] for axis in "xyz"], wanted, atol=1e-6)


@pytest.mark.slow
def test_a_cam_of_a_cad_file_lifts_as_the_closed_form_says(tmp_path):
    """The tip of a follower on an ellipse that turns: its height is the radius of the ellipse at the angle."""
    a, b, speed = 8.0, 5.0, 2 * pi / 100.0
    axle, guide = {"point": [0, 0, 0], "axis": [0, 0, 1]}, {"axis": [0, 1, 0]}
    changes = {
        "gravity": [0.0, -0.5, 0.0],
        "bodies": {
            "ground": {"fixed": True},
            "block": {"part": "block", "density": 1e-3},
            "probe": {"mass": 1.0, "inertia": [1.0] * 3, "origin": [0.0, b, 3.0]},
        },
        "joints": {
            "axle": {"type": "revolute", "bearing": {"body": "ground", **axle}, "journal": {"body": "block", **axle}},
            "guide": {
                "type": "prismatic",
                "guide": {"body": "ground", "point": [0, 0, 3], **guide},
                "slider": {"body": "probe", "point": [0, 0, 0], **guide},
            },
        },
        "contacts": {
            "touch": {
                "a": {"body": "probe", "point": [0.0, 0.0, 0.0]},
                "b": {"body": "block", "surface": {"faces": [{"near": [a, 0.0, 3.0]}], "conversion": 1e-6}},
                "friction": 0.0,
            }
        },
        "motions": {"drive": {"body": "block", "about": {"axis": [0, 0, 1]}, "law": {"speed": speed}}},
        "simulation": {"step": 0.05, "horizon": 100.0, "rest": {"window": 1.0, "drift": 1e-6}},
        "responses": {
            "angle": {"type": "angle", "body": "block", "axis": [0, 0, 1]},
            "height": {**height("y"), "from": {"body": "ground", "point": [0, 0, 0]}},
        },
    }
    mechanism = loaded(tmp_path, one_part(elliptic_cam(a, b, 6.0)), {}, changes)
    run = simulate(mechanism, full_horizon=True, trajectory=tmp_path / "run.h5")
    assert run.status == "ok", run.message
    history = read_trajectory(tmp_path / "run.h5")
    angle, pressed = history.responses["angle"], history.contacts["touch"].impulse[:, 0] > 0
    lift = a * b / np.hypot(a * np.cos(angle), b * np.sin(angle))
    above = history.responses["height"] - lift
    error = next(iter(mechanism.geometry.faces.values())).conversion_error
    assert 0 < error <= 1e-6
    assert above.min() > -error - 1e-8 / cos(0.5)
    assert pressed.mean() > 0.95
    assert np.abs(above[pressed]).max() < 2e-4  # the error of the step, see the cams of closed forms
