"""A roller on an eccentric cam: contact force and torque of the drive against those of the equivalent slider-crank."""

import math

import numpy as np
import pytest

from engine import load_mechanism, read_trajectory, simulate

ECCENTRICITY, LENGTH, MASS, STIFFNESS, PRELOAD = 3.0, 20.0, 100.0, 0.8, 5.0  # mm, mm, g, N/mm, N
SPEED = 0.02 * math.pi  # rad/ms: 600 1/min
TURN = 2 * math.pi / SPEED  # ms


def cam(steps):
    """Describe a follower that a spring presses on a cam, which turns at a constant speed, ``steps`` steps a turn."""
    lowest, wall = LENGTH - ECCENTRICITY, 60.0
    z, origin = [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]
    return load_mechanism(
        {
            "format": 1,
            "name": "cam",
            "units": "mm-g-ms",
            "simulation": {
                "step": TURN / steps,
                "horizon": 2 * TURN,
                "penetration": 1e-6,
                "rest": {"window": 1.0, "drift": 1e-5},
            },
            "phases": [{"name": "run", "duration": TURN}],
            "bodies": {
                "base": {"fixed": True},
                "cam": {"mass": 200.0, "inertia": [1e4] * 3},
                "follower": {"mass": MASS, "inertia": [1e3] * 3, "origin": [0.0, LENGTH + ECCENTRICITY, 0.0]},
            },
            "joints": {
                "shaft": {
                    "type": "revolute",
                    "bearing": {"body": "base", "point": origin, "axis": z},
                    "journal": {"body": "cam", "point": origin, "axis": z},
                },
                "guide": {
                    "type": "prismatic",
                    "guide": {"body": "base", "point": origin, "axis": [0.0, 1.0, 0.0]},
                    "slider": {"body": "follower", "point": origin, "axis": [0.0, 1.0, 0.0]},
                },
            },
            "contacts": {
                "rolls": {
                    "friction": 0.0,
                    "a": {"body": "follower", "sphere": {"centre": origin, "radius": 5.0}},
                    "b": {
                        "body": "cam",
                        "cylinder": {"point": [0.0, ECCENTRICITY, 0.0], "axis": z, "radius": LENGTH - 5.0},
                    },
                }
            },
            "springs": {
                "press": {
                    "type": "linear",
                    "a": {"body": "base", "point": [0.0, wall, 0.0]},
                    "b": {"body": "follower", "point": origin},
                    "stiffness": STIFFNESS,
                    "free_length": wall - lowest + PRELOAD / STIFFNESS,
                }
            },
            "motions": {"drive": {"body": "cam", "about": {"axis": z}, "law": {"speed": SPEED}}},
            "responses": {
                "force": {"type": "contact_force", "contact": "rolls"},
                "largest": {"type": "contact_force", "contact": "rolls", "at": "maximum"},
                "smallest": {"type": "contact_force", "contact": "rolls", "at": "minimum"},
                "torque": {"type": "motion_torque", "motion": "drive"},
            },
        }
    )


def exact_force(angle):
    """Force [N] of the contact, along the line of centres, from the motion of a slider-crank of the same lengths."""
    s, c = ECCENTRICITY * np.sin(angle), ECCENTRICITY * np.cos(angle)
    rod = np.sqrt(LENGTH**2 - s**2)
    height = c + rod
    acceleration = SPEED**2 * (-c - (c * c - s * s) / rod - (s * c) ** 2 / rod**3)
    along = STIFFNESS * (height - LENGTH + ECCENTRICITY) + PRELOAD + MASS * acceleration
    return along * LENGTH / rod


@pytest.mark.parametrize("steps", [500, 2000])
def test_the_force_of_a_lasting_contact_does_not_swing_about_the_right_one(tmp_path, steps):
    """It did by a third, however short the step: each step closed what the last had opened by its curved path."""
    run = simulate(cam(steps), trajectory=tmp_path / "cam.h5")
    assert run.status == "ok", run.message
    motion = read_trajectory(tmp_path / "cam.h5")
    force, exact = motion.responses["force"][:], exact_force(SPEED * motion.time[:])
    settled = slice(steps // 50, -1)  # the drive starts with a jump of its speed
    assert np.abs(force - exact)[settled].max() < 40.0 / steps
    assert run.responses["smallest"] > 0.99 * exact.min() - 20.0 / steps
