"""Cams and followers against their lift in closed form: an eccentric circle, and a cam of two circles and two tangents.

A roller of radius ``ROLLER`` is guided along y above the axis of a cam that turns at a constant speed; gravity holds it
down. What is compared is the height of its centre, at each step and the angle that the cam then has.
"""

import math
from typing import Any

import numpy as np
import pytest

from tests.engine.oracles.reference import order, recorded
from tests.engine.small import small

ROLLER, ECCENTRIC = 2.0, {"radius": 6.0, "off": 2.5}
BASE, NOSE, BETWEEN = 6.0, 3.0, 5.0  # radii of the tangent cam's two circles, and the distance of their centres
CIRCLE = {
    "start": [ECCENTRIC["off"] + ECCENTRIC["radius"], 0],
    "profile": [{"to": [8.5, 0], "centre": [ECCENTRIC["off"], 0], "turn": "left"}],
}
TANGENT = {
    "start": [6.8, -2.4],
    "profile": [
        {"to": [6.8, 2.4], "centre": [BETWEEN, 0], "turn": "left"},
        {"to": [3.6, 4.8]},
        {"to": [3.6, -4.8], "centre": [0, 0], "turn": "left"},
    ],
}


def eccentric_lift(angle: np.ndarray) -> np.ndarray:
    """Return the height of the roller's centre over the cam's axis; at the angle 0 the eccentricity points up."""
    e, reach = ECCENTRIC["off"], ECCENTRIC["radius"] + ROLLER
    return e * np.cos(angle) + np.sqrt(reach**2 - (e * np.sin(angle)) ** 2)


def tangent_lift(angle: np.ndarray) -> np.ndarray:
    """Return the same over the nose, a flank or the base; at the angle 0 the nose points up."""
    turn = np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
    flank = math.acos((BASE - NOSE) / BETWEEN)  # direction of a flank's normal, from that of the nose
    nose_ends = math.atan2((NOSE + ROLLER) * math.sin(flank), BETWEEN + (NOSE + ROLLER) * math.cos(flank))
    over_nose = BETWEEN * np.cos(turn) + np.sqrt(np.maximum((NOSE + ROLLER) ** 2 - (BETWEEN * np.sin(turn)) ** 2, 0))
    over_flank = (BASE + ROLLER) / np.cos(np.minimum(np.abs(flank - turn), 1.0))
    return np.where(turn <= nose_ends, over_nose, np.where(turn <= flank, over_flank, BASE + ROLLER))


def cam(profile: dict[str, Any], first: float) -> dict[str, Any]:
    """Describe a cam whose profile has x upwards at the start, and a roller at the height ``first`` over its axis."""
    extruded = {"point": [0, 0, 0], "axis": [0, 0, 1], "along": [0, 1, 0], "half_length": 3.0, **profile}
    axle, guide = {"point": [0, 0, 0], "axis": [0, 0, 1]}, {"axis": [0, 1, 0]}
    return small(
        units="mm-g-ms",
        gravity=[0, -0.05, 0],
        simulation={"step": 0.05, "horizon": 100.0, "penetration": 1e-9, "rest": {"window": 1.0, "drift": 1e-6}},
        bodies={
            "ground": {"fixed": True},
            "cam": {"mass": 5.0, "inertia": [100.0, 100.0, 200.0]},
            "follower": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "origin": [0, first, 0]},
        },
        joints={
            "axle": {"type": "revolute", "bearing": {"body": "ground", **axle}, "journal": {"body": "cam", **axle}},
            "guide": {
                "type": "prismatic",
                "guide": {"body": "ground", "point": [0, 0, 0], **guide},
                "slider": {"body": "follower", "point": [0, 0, 0], **guide},
            },
        },
        contacts={
            "roller": {
                "a": {"body": "follower", "sphere": {"centre": [0, 0, 0], "radius": ROLLER}},
                "b": {"body": "cam", "extruded": extruded},
                "friction": 0.0,
            }
        },
        motions={"drive": {"body": "cam", "about": {"axis": [0, 0, 1]}, "law": {"speed": 0.0628}}},
        responses={
            "angle": {"type": "angle", "body": "cam", "axis": [0, 0, 1]},
            "height": {
                "type": "position",
                "from": {"body": "ground", "point": [0, 0, 0]},
                "to": {"body": "follower", "point": [0, 0, 0]},
                "direction": {"vector": [0, 1, 0]},
            },
        },
    )


def risen(profile: dict[str, Any], lift: Any, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return how far the roller is above the lift at every step of a whole turn, and whether it is pressed on."""
    run = recorded(cam(profile, float(lift(np.array(0.0)))), step)
    assert run.responses["angle"][-1] > 2 * np.pi - 0.01
    pressed = run.contacts["roller"].impulse[:, 0] > 0
    return run.responses["height"] - lift(run.responses["angle"]), pressed


def test_an_eccentric_circle_lifts_as_the_closed_form_says():
    """Never below it by more than the penetration allowed, and above by what vanishes with the square of the step."""
    steps, worst = [0.2, 0.1, 0.05], []
    for step in steps:
        above, pressed = risen(CIRCLE, eccentric_lift, step)
        assert above.min() > -2e-9
        assert pressed.mean() > 0.99
        worst.append(above.max())
    assert order(steps, worst) == pytest.approx(2.0, abs=0.1)
    assert worst[-1] < 2.5e-5


def test_a_tangent_cam_lifts_as_the_closed_form_says():
    """Over nose, flanks and base. Where a flank passes into a circle the roller takes a step or two to press again."""
    above, pressed = risen(TANGENT, tangent_lift, 0.05)
    assert above.min() > -2e-9
    assert pressed.mean() > 0.99
    assert above[pressed].max() < 5e-5
    assert above.max() < 3e-4
