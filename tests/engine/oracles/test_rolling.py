"""Bodies that roll for long, and a block that rocks: how much they lose with each step, against closed forms."""

from typing import Any

import numpy as np
import pytest

from engine import simulate
from engine.run import Run
from tests.engine.oracles.machines import DOWN, GROUND, UNIT, along, brick
from tests.engine.oracles.reference import order
from tests.engine.small import FLOOR, GRAVITY, made, small


def moved(step: float, duration: float, **tables: Any) -> Run:
    """Run a mechanism that moves for a given duration, with fixed steps."""
    simulation = {"step": step, "horizon": duration, **tables.pop("simulation", {})}
    phases = [{"name": "motion", "duration": duration}]
    run = simulate(made(small(simulation=simulation, phases=phases, gravity=DOWN, **tables)))
    assert run.status == "ok", run.message
    return run


def eulers_disc(step: float) -> float:
    """Return the share of its energy that a disc loses which rolls on its edge for 0.5 s, its centre at rest.

    It precesses at W with W^2 sin(tilt) = 4 g / R, and turns about the diameter through its contact at W sin(tilt).
    """
    radius, tilt, mass, duration = 0.05, np.radians(20.0), 0.4, 0.5
    rate = np.sqrt(4 * GRAVITY / (radius * np.sin(tilt)))
    across = mass * radius**2 / 4
    body = {"mass": mass, "inertia": [across, across, 2 * across], "origin": [0, 0, radius * np.sin(tilt)]}
    # tilted about y: its lowest point lies ahead along its own x
    body |= {"axis": [0, 1, 0], "angle": tilt, "angular_velocity": [-rate * np.sin(tilt), 0, 0]}
    arc = {"centre": [0, 0, 0], "normal": [0, 0, 1], "middle": [1, 0, 0], "radius": radius, "half_angle": np.pi}
    edge = {"a": {"body": "disc", "arc": arc}, "b": {"body": "ground", "plane": FLOOR}, "friction": 1.0}
    speed = {"type": "velocity", "to": {"body": "disc", "point": [0, 0, 0]}}
    spin = {"type": "angular_velocity", "body": "disc"}
    found = moved(
        step,
        duration,
        bodies={"ground": GROUND, "disc": body},
        contacts={"edge": edge},
        responses={
            "height": along("z", "disc"),
            **{f"v{a}": speed | {"direction": {"vector": UNIT[a]}} for a in "xyz"},
            **{f"w{a}": spin | {"axis": UNIT[a]} for a in "xyz"},
        },
    ).responses
    spins = sum(found[f"w{a}"] ** 2 for a in "xyz")
    speeds = sum(found[f"v{a}"] ** 2 for a in "xyz")
    # about its own axis it hardly turns: across is the moment of inertia of the whole spin
    energy = mass * GRAVITY * found["height"] + 0.5 * mass * speeds + 0.5 * across * spins
    return float(1 - energy / (1.5 * mass * GRAVITY * radius * np.sin(tilt)))


def turntable(step: float) -> float:
    """Return how far from its circle a ball is that rolls on a turning table for 10 s.

    Its centre goes round at 2/7 of the table's speed, on the circle that its first velocity gives.
    """
    turning, radius, mass, duration, start = 3.0, 0.02, 0.1, 10.0, 0.1
    rate = 2 / 7 * turning
    inertia = 2 / 5 * mass * radius**2
    velocity = np.array([0.0, rate * start, 0.0])
    # without slip: v + w x (-r z) = W z x p
    slip = np.array([0.0, turning * start, 0.0]) - velocity
    ball = {"mass": mass, "inertia": [inertia] * 3, "origin": [start, 0, radius], "velocity": velocity.tolist()}
    ball |= {"angular_velocity": [slip[1] / radius, -slip[0] / radius, 0.0]}
    table = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "angular_velocity": [0, 0, turning]}
    found = moved(
        step,
        duration,
        bodies={"ground": GROUND, "table": table, "ball": ball},
        joints={
            "axle": {
                "type": "revolute",
                "bearing": {"body": "ground", "point": [0, 0, 0], "axis": UNIT["z"]},
                "journal": {"body": "table", "point": [0, 0, 0], "axis": UNIT["z"]},
            }
        },
        motions={"turn": {"body": "table", "about": {"axis": UNIT["z"]}, "law": {"speed": turning}}},
        contacts={
            "under": {
                "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": radius}},
                "b": {"body": "table", "plane": FLOOR},
                "friction": 1.0,
            }
        },
        responses={"x": along("x", "ball"), "y": along("y", "ball")},
    ).responses
    return float(np.hypot(found["x"], found["y"]) - start)


def rocking_block(step: float) -> float:
    """Return the share of its energy that a block keeps in its first impact as it rocks from edge to edge."""
    slenderness = np.arcsin(np.sqrt(0.1))  # angle from its edge to its middle
    far, tilt, mass = 0.5, 0.6 * slenderness, 1.0
    half = [far * np.sin(slenderness), 0.2, far * np.cos(slenderness)]
    sin, cos = np.sin(tilt), np.cos(tilt)
    block = brick(mass, half, axis=UNIT["y"], angle=tilt)  # on the edge at the origin
    block["origin"] = [half[2] * sin - half[0] * cos, 0, half[0] * sin + half[2] * cos]
    corners = {
        f"corner_{i}": {
            "a": {"body": "block", "point": [x * half[0], y * half[1], -half[2]]},
            "b": {"body": "ground", "plane": FLOOR},
            "friction": 3.0,
        }
        for i, (x, y) in enumerate([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    }
    angle = {"type": "angle", "body": "block", "axis": UNIT["y"], "offset": tilt}
    run = moved(
        step,
        1.0,
        bodies={"ground": GROUND, "block": block},
        contacts=corners,
        responses={"least": angle | {"at": "minimum"}, "most": angle | {"at": "maximum"}},
    )
    other = -run.responses["least"]

    def lifted(tilt: float) -> float:
        return float(np.cos(slenderness - tilt) - np.cos(slenderness))

    return lifted(other) / lifted(tilt)


STEPS = [4e-4, 2e-4, 1e-4]


def test_eulers_disc_loses_energy_in_proportion_to_the_step():
    """Its contact is on a curve, so each radian costs a share of about the angle of a step; in theory, nothing."""
    lost = [eulers_disc(step) for step in STEPS]
    assert order(STEPS, lost) == pytest.approx(1.0, abs=0.1)
    assert lost[-1] < 0.03


def test_a_ball_on_a_turntable_leaves_its_circle_in_proportion_to_the_step():
    """By 4 mm in ten seconds with a step of 4 ms, and by a quarter of that with 1 ms."""
    steps = [4e-3, 2e-3, 1e-3]
    off = [turntable(step) for step in steps]
    assert order(steps, off) == pytest.approx(1.0, abs=0.1)
    assert off[-1] < 2e-3


def test_a_block_rocks_as_housner_says():
    """An impact keeps (1 - 1.5 sin^2)^2 = 0.7225 of the energy: angular momentum about the new edge."""
    steps = [2e-3, 1e-3, 5e-4, 2.5e-4]
    off = [0.7225 - rocking_block(step) for step in steps]
    assert abs(off[-1]) < 3e-3
