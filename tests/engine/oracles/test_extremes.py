"""Snap-through, inconsistent friction, fast spin, rows of balls, rest after bounces: against closed forms and SciPy."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from engine import simulate
from engine.run import Run
from tests.each import each
from tests.engine.oracles.machines import DOWN, GROUND, UNIT, along, brick, feet, force, slide
from tests.engine.oracles.reference import order
from tests.engine.small import CORNERS, FLOOR, GRAVITY, coordinates, made, small


def moving(step: float, duration: float, **tables: Any) -> dict[str, Any]:
    """Describe a mechanism that moves for a given duration, with fixed steps."""
    simulation = {"step": step, "horizon": duration}
    return small(simulation=simulation, phases=[{"name": "motion", "duration": duration}], **tables)


def ran(data: dict[str, Any]) -> Run:
    """Run a mechanism, which has to be ok."""
    run = simulate(made(data))
    assert run.status == "ok", run.message
    return run


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_ball_that_stops_exactly_and_then_bears_nothing(friction):
    """At 100 m/s, a metre a step, from 9.5 m: it touches at the middle of a step, and no load acts afterwards."""
    contact = {
        "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": 0.5}},
        "b": {"body": "ground", "plane": FLOOR},
        "friction": friction,
    }
    ball = {"mass": 1.0, "inertia": [0.1] * 3, "origin": [0, 0, 10.0], "velocity": [0, 0, -100.0]}
    bodies = {"ground": GROUND, "ball": ball}
    found = ran(moving(1e-2, 3.0, bodies=bodies, contacts={"touch": contact}, responses=coordinates("ball")))
    assert found.responses["z"] == pytest.approx(0.5, abs=1e-12)


def test_a_motion_that_a_step_is_too_long_for_is_lost_at_once():
    """A spring of 1e9 N/m at a step of 10 ms throws its body ever further: the run ends within a few steps of that."""
    spring = {
        "type": "linear",
        "a": {"body": "ground", "point": [0, 0, 0]},
        "b": {"body": "block", "point": [0, 0, 0]},
        "stiffness": 1e9,
        "free_length": 1.0,
    }
    bodies = {"ground": GROUND, "block": brick(1.0, (0.1, 0.1, 0.1), origin=[0, 0, 1.001])}
    run = simulate(made(moving(1e-2, 1.0, bodies=bodies, springs={"s": spring})))
    assert run.status == "diverged"
    assert run.certificate.steps <= 4


def top(spin: float, tilt: float, step: float) -> tuple[float, float]:
    """Return the precession in a second of a heavy top on its point, simulated and in closed form [rad].

    A0 W^2 cos - C n W + m g l = 0 for the slow one of the two steady precessions; n is the spin about the axis.
    """
    mass, length, across, axial = 1.0, 0.1, 0.002, 0.001
    a, b, c = (across + mass * length**2) * np.cos(tilt), -axial * spin, mass * GRAVITY * length
    rate = (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
    axis = np.array([np.sin(tilt), 0, np.cos(tilt)])
    turning = np.array([0, 0, rate]) + (spin - rate * np.cos(tilt)) * axis
    own = [np.cos(tilt) * turning[0] - np.sin(tilt) * turning[2], 0.0, axis @ turning]
    body = {
        "mass": mass, "inertia": [across, across, axial], "origin": (length * axis).tolist(), "axis": [0, 1, 0],
        "angle": tilt, "velocity": np.cross(turning, length * axis).tolist(), "angular_velocity": own,
    }  # fmt: skip
    socket = {"body": "ground", "point": [0, 0, 0]}
    joints = {"tip": {"type": "spherical", "socket": socket, "ball": {"body": "top", "point": [0, 0, -length]}}}
    bodies = {"ground": GROUND, "top": body}
    found = ran(moving(step, 1.0, gravity=DOWN, bodies=bodies, joints=joints, responses=coordinates("top"))).responses
    assert found["z"] == pytest.approx(length * np.cos(tilt), rel=0.02)
    return float(np.arctan2(found["y"], found["x"])), float(rate)


@pytest.mark.parametrize("spin", [400.0, 800.0])
def test_a_heavy_top_precesses_as_fast_as_it_must(spin):
    """Of second order in the step, down to 0.4 % of its way with 0.2 rad a step."""
    steps = [1e-3, 5e-4, 2.5e-4]
    off = []
    for step in steps:
        found, expected = top(spin, 0.5, step)
        off.append(abs(found - expected))
    assert off[-1] < 8e-3
    assert 1.8 < order(steps, off) < 2.2


@pytest.mark.parametrize("mass", [0.1, 1e-2, 1e-3, 1e-4])
def test_a_light_rod_on_joints_with_play_swings_a_ton(mass):
    """As a simple pendulum, longer by both clearances, whatever the rod weighs; friction at two pins takes little.

    With 1e-5 kg rounding decides: in one run of four a step's friction problem stays above the tolerance of 1e-8.
    """
    play, friction, radius, start = 5e-5, 0.1, 0.01, 0.1  # m, rad
    length = 1.0 + 2 * play
    hang, aside = np.array([np.sin(start), 0, -np.cos(start)]), {"axis": [0, 1, 0], "angle": -start}
    joint = {"type": "clearance_revolute", "rings": [-0.02, 0.02], "radial_clearance": play, "friction": friction}

    def pin(bearing, at, journal, there):
        sides = {"bearing": {"body": bearing, "point": at, "axis": [0, 1, 0]}}
        return joint | sides | {"journal": {"body": journal, "point": there, "axis": [0, 1, 0], "radius": radius}}

    bodies = {
        "ground": GROUND,
        "rod": {
            "mass": mass,
            "inertia": [mass / 12, mass / 12, mass / 1200],
            "origin": ((0.5 + play) * hang).tolist(),
            **aside,
        },
        "ton": {"mass": 1000.0, "inertia": [10.0] * 3, "origin": (length * hang).tolist()},
    }
    joints = {"top": pin("rod", [0, 0, 0.5], "ground", [0, 0, 0]), "low": pin("rod", [0, 0, -0.5], "ton", [0, 0, 0])}
    found = ran(moving(1e-3, 0.5, gravity=DOWN, bodies=bodies, joints=joints, responses=coordinates("ton")))
    exact = solve_ivp(lambda _, y: [y[1], -GRAVITY / length * np.sin(y[0])], (0, 0.5), [start, 0], rtol=1e-10).y[0, -1]
    braked = 2 * friction * GRAVITY * radius * 0.5**2 / 2  # at most
    assert found.responses["x"] == pytest.approx(length * np.sin(exact), abs=braked)
    assert found.responses["z"] == pytest.approx(-length * np.cos(exact), abs=start * braked)


def truss(load: float) -> dict[str, Any]:
    """Push a mass on two springs, a flat roof, down by a load that grows slowly; a stop is far below."""
    spring = {"type": "linear", "stiffness": 1000.0, "free_length": float(np.hypot(0.2, 0.05)), "damping": 3.0}
    springs = {
        name: {**spring, "a": {"body": "ground", "point": [side, 0, 0]}, "b": {"body": "mass", "point": [0, 0, 0]}}
        for name, side in (("left", -0.2), ("right", 0.2))
    }
    below = {"point": [0, 0, -0.1], "normal": [0, 0, 1]}
    stop = {"a": {"body": "mass", "point": [0, 0, 0]}, "b": {"body": "ground", "plane": below}, "friction": 0.0}
    return small(
        simulation={"horizon": 40.0}, phases=[{"name": "load", "duration": 4.0}, {"name": "rest"}],
        bodies={"ground": GROUND, "mass": {"mass": 0.1, "inertia": [1e-4] * 3, "origin": [0, 0, 0.05]}},
        joints={"guide": slide("mass", [0, 0, 0.05], "z")}, springs=springs, contacts={"stop": stop},
        forces={"load": {"body": "mass", "force": [0, 0, -load], "law": {"table": [[0, 0], [4, 1]]}}},
        responses={"z": along("z", "mass"), "stop": force("stop")},
    )  # fmt: skip


@pytest.mark.parametrize("share", [0.9, 0.99, 1.01, 1.1])
def test_a_roof_snaps_through_at_its_critical_load(share):
    """It comes to rest on its springs alone, although a force is measured: that of a stop that it does not reach."""
    length = np.hypot(0.2, 0.05)

    def holds(z):
        return 2000.0 * (length - np.hypot(0.2, z)) * z / np.hypot(0.2, z)

    heights = np.linspace(0, 0.05, 5001)
    top = float(heights[np.argmax(holds(heights))])
    load, between = share * holds(top), (top, 0.05) if share < 1 else (-0.15, -0.05)
    found = ran(truss(load)).responses
    assert found["z"] == pytest.approx(brentq(lambda z: holds(z) - load, *between), abs=1e-6)
    assert found["stop"] == 0.0


@pytest.mark.parametrize("friction", [1.5, 2.5])
def test_a_rod_with_inconsistent_friction_is_stopped_at_once(friction):
    """Painleve: above 1.38 no finite force balances the sliding rod, and the first step has an impact that sticks.

    It takes all of the tip's speed, along the floor too: linear and angular momentum.
    """
    tilt, half, mass, inertia, step = 1.0, 0.5, 1.0, 1 / 12, 1e-5
    arm = half * np.array([np.cos(tilt), np.sin(tilt)])  # x, z from the tip
    rod = {"mass": mass, "inertia": [1e-3, inertia, inertia], "origin": [arm[0], 0, arm[1]]}
    rod |= {"axis": [0, 1, 0], "angle": -tilt, "velocity": [-5.0, 0, 0]}
    tip = {"a": {"body": "rod", "point": [-half, 0, 0]}, "b": {"body": "ground", "plane": FLOOR}, "friction": friction}
    velocity = {"type": "velocity", "to": {"body": "rod", "point": [0, 0, 0]}}
    found = ran(
        moving(
            step, step, gravity=DOWN, bodies={"ground": GROUND, "rod": rod}, contacts={"tip": tip},
            responses={axis: velocity | {"direction": {"vector": UNIT[axis]}} for axis in "xz"},
        )
    ).responses  # fmt: skip
    # about the tip: m (z vx - x vz) stays, and afterwards the rod turns about it
    spin = -5.0 * mass * arm[1] / (inertia + mass * half**2)
    assert found["x"] == pytest.approx(spin * arm[1], abs=1e-3)
    assert found["z"] == pytest.approx(-spin * arm[0], abs=1e-3)


AT_ONCE, IN_TURN = [-0.6, 0.4, 0.4, 0.4, 0.4], [0, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("gap", "expected"), [(0.0, AT_ONCE), (1e-9, AT_ONCE), (1e-5, AT_ONCE), (1e-3, IN_TURN), (5e-3, IN_TURN)]
)
def test_a_row_of_balls_follows_newtons_law(gap, expected):
    """Balls that touch are struck at once: Newton's law gives all the same speed, and not what a cradle shows.

    Gaps much smaller than a step's travel, here 1 mm, count as none; over larger ones they pass the impact on in turn.
    """
    balls = {
        f"ball_{i}": {"mass": 1.0, "inertia": [1e-3] * 3, "origin": [i * (0.1 + gap) - (0.1 if i == 0 else 0), 0, 0]}
        for i in range(5)
    }
    balls["ball_0"]["velocity"] = [1.0, 0, 0]
    sphere = {"sphere": {"centre": [0, 0, 0], "radius": 0.05}}
    contacts = {
        f"hit_{i}": {
            "a": {"body": f"ball_{i}", **sphere}, "b": {"body": f"ball_{i + 1}", **sphere},
            "friction": 0.0, "restitution": 1.0,
        } for i in range(4)
    }  # fmt: skip
    speed = {"type": "velocity", "direction": {"vector": [1, 0, 0]}}
    responses = {name: speed | {"to": {"body": name, "point": [0, 0, 0]}} for name in balls}
    found = ran(moving(1e-3, 0.5, bodies={"ground": GROUND} | balls, contacts=contacts, responses=responses)).responses
    assert list(found.values()) == pytest.approx(expected, abs=1e-6)


@each("size", [1e-5, 1.0, 10.0])
@each(("friction", "restitution"), [(1.5, 0.0), (0.3, 0.5), (1.5, 0.9)])
def test_a_brick_that_has_bounced_lies_on_the_floor(size, friction, restitution):
    """And not above it by what it moves in a step: near rest nothing bounces, and gaps close."""
    time = float(np.sqrt(size / GRAVITY))
    contacts = {
        f"corner_{i}": {
            "a": {"body": "brick", "point": [size * x for x in corner]}, "b": {"body": "ground", "plane": FLOOR},
            "friction": friction, "restitution": restitution,
        } for i, corner in enumerate(CORNERS)
    }  # fmt: skip
    fallen = brick(8e3 * size**3, [size] * 3, origin=[0, 0, 2 * size], axis=[1, 0.3, 0.2], angle=0.2)
    simulation = {
        "step": 2e-4 * time, "adaptive": {"longest": 2e-2 * time, "travel": 2e-3 * size}, "horizon": 60 * time,
        "penetration": 1e-8 * size, "rest": {"window": 0.05 * time, "drift": 1e-7 * size},
    }  # fmt: skip
    data = small(
        simulation=simulation, gravity=DOWN, bodies={"ground": GROUND, "brick": fallen}, contacts=contacts,
        responses={"z": along("z", "brick")},
    )  # fmt: skip
    assert ran(data).responses["z"] == pytest.approx(size, rel=1e-7)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_pendulum_meets_its_stop(restitution):
    """Impacts at known instants between swings (DOP853): of first order in the step, and at rest without bounce."""
    start, length, mass, own, until = 1.0, 0.5, 1.0, 0.01, 2.0
    inertia = own + mass * length**2

    def rates(_, y):
        return [y[1], -mass * GRAVITY * length / inertia * np.sin(y[0])]

    def stop(_, y):
        return y[0]

    stop.terminal, stop.direction = True, -1
    t, y = 0.0, np.array([start, 0.0])
    while t < until and y.any():
        swing = solve_ivp(rates, (t, until), y, "DOP853", events=stop, rtol=1e-11, atol=1e-13)
        t, y = swing.t[-1], swing.y[:, -1]
        if t < until:
            y = np.array([0.0 if restitution == 0 else 1e-15, -restitution * y[1]])
    body = {"mass": mass, "inertia": [own] * 3, "axis": [0, 1, 0], "angle": -start}
    body["origin"] = [length * np.sin(start), 0, -length * np.cos(start)]
    pin = {"axis": [0, 1, 0]}
    wall = {"point": [0, 0, 0], "normal": [1, 0, 0]}
    data = moving(
        5e-4, until, gravity=DOWN, bodies={"ground": GROUND, "bob": body},
        joints={"pin": {"type": "revolute", "bearing": {**pin, "body": "bob", "point": [0, 0, length]},
                        "journal": {**pin, "body": "ground", "point": [0, 0, 0]}}},
        contacts={"stop": {"a": {"body": "bob", "point": [0, 0, 0]}, "b": {"body": "ground", "plane": wall},
                           "friction": 0.0, "restitution": restitution}},
        responses={"angle": {"type": "angle", "body": "bob", "relative_to": "ground", "axis": [0, 1, 0]}},
    )  # fmt: skip
    assert start - ran(data).responses["angle"] == pytest.approx(y[0], abs=3e-4)


def test_a_block_on_a_belt_sticks_and_slips():
    """It swings about mu m g / k with the speed of the belt, once that has caught it."""
    stiffness, friction, speed, until, half = 100.0, 0.3, 0.2, 2.0, [0.05] * 3
    rate, middle = np.sqrt(stiffness), friction * GRAVITY / stiffness
    caught = np.arcsin(speed / (middle * rate)) / rate
    slips = caught + (middle - middle * (1 - np.cos(rate * caught))) / speed
    spring = {"type": "linear", "stiffness": stiffness, "free_length": 1.0}
    spring |= {"a": {"body": "ground", "point": [-1, 0, 0.05]}, "b": {"body": "block", "point": [0, 0, 0]}}
    motion = {"body": "belt", "relative_to": "ground", "along": {"point": [0, 0, 0], "direction": [1, 0, 0]}}
    bodies = {"ground": GROUND, "belt": {"mass": 1.0, "inertia": [1.0] * 3}}
    data = moving(
        5e-4, until, gravity=DOWN, bodies=bodies | {"block": brick(1.0, half, origin=[0, 0, 0.05])},
        joints={"way": slide("belt", [0, 0, 0], "x")}, contacts=feet("block", half, "belt", 0.0, friction),
        springs={"spring": spring}, motions={"belt": motion | {"law": {"speed": speed}}},
        responses={"x": along("x", "block")},
    )  # fmt: skip
    expected = middle + speed / rate * np.sin(rate * (until - slips))
    assert ran(data).responses["x"] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("rate", [3.0, 6.0])
def test_a_block_on_a_turning_disc_stays_or_flies_off(rate):
    """Where it sticks it drifts outward by half a step's angle a radian; where it slides, Coulomb's law (DOP853)."""
    radius, friction, until, step, size = 0.2, 0.3, 0.3, 2e-4, 0.002
    block = brick(0.01, [size] * 3, origin=[radius, 0, size], velocity=[0, rate * radius, 0])
    block["angular_velocity"] = [0, 0, rate]
    axle = {"point": [0, 0, 0], "axis": [0, 0, 1]}
    bodies = {"ground": GROUND, "disc": {"mass": 5.0, "inertia": [0.1] * 3}, "block": block}
    pin = {"bearing": {**axle, "body": "disc"}, "journal": {**axle, "body": "ground"}}
    motor = {"body": "disc", "relative_to": "ground", "about": {"axis": [0, 0, 1]}, "law": {"speed": rate}}
    data = moving(
        step, until, gravity=DOWN, bodies=bodies, joints={"axle": {"type": "revolute", **pin}},
        contacts=feet("block", [size] * 3, "disc", 0.0, friction), motions={"motor": motor},
        responses={axis: along(axis, "block") for axis in "xy"},
    )  # fmt: skip

    def slides(_, y):
        slip = np.array([y[2] + rate * y[1], y[3] - rate * y[0]])
        return [y[2], y[3], *(-friction * GRAVITY * slip / max(np.hypot(*slip), 1e-9))]

    if rate**2 * radius > friction * GRAVITY:
        expected = solve_ivp(slides, (0, until), [radius, 0, 0, rate * radius], rtol=1e-9, atol=1e-11).y[:2, -1]
    else:
        expected = radius * np.array([np.cos(rate * until), np.sin(rate * until)])
    drift = radius * rate**2 * step * until
    assert list(ran(data).responses.values()) == pytest.approx(expected, abs=drift)
