"""Mechanisms of capsules, cylinders and boxes: what rolls, what is pressed, what lies, slides and tips."""

import numpy as np
import pytest

from engine import simulate
from engine.mechanism import set_values
from tests.engine.kernels.test_hulls import block, mesh_of
from tests.engine.small import FLOOR, GRAVITY, coordinates, made, small

ALONG_Y = {"point": [0, 0, 0], "axis": [0, 1, 0]}


def rolling(slope=0.3):
    """Let a capsule roll down a slope; its axis is level."""
    return small(
        gravity=[GRAVITY * np.sin(slope), 0, -GRAVITY * np.cos(slope)],
        simulation={"step": 1e-3, "horizon": 0.5},
        bodies={
            "ground": {"fixed": True},
            "pin": {"mass": 0.2, "inertia": [8e-5, 1e-5, 8e-5], "origin": [0, 0, 0.01]},
        },
        contacts={
            "roll": {
                "a": {"body": "pin", "capsule": {**ALONG_Y, "radius": 0.01, "half_length": 0.03}},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": 0.5,
            }
        },
        responses={**coordinates("pin"), "force": {"type": "contact_force", "contact": "roll"}},
    )


def test_a_capsule_rolls_down_a_slope():
    """The acceleration is g sin / (1 + I / (m r^2)), here a half; both ends carry."""
    run = simulate(made(rolling()), full_horizon=True)
    expected = 0.5 * GRAVITY * np.sin(0.3) / (1 + 1e-5 / (0.2 * 0.01**2)) * 0.5**2
    assert run.responses["x"] == pytest.approx(expected, rel=3e-3)
    assert run.responses["y"] == pytest.approx(0.0, abs=1e-9)
    assert run.responses["force"] == pytest.approx(0.2 * GRAVITY * np.cos(0.3), rel=1e-6)


def crossed(angle, radius=0.02):
    """Press a cylinder in a guide on a fixed one, across it by an angle; their lengths are 60 and 100 mm."""
    guide = {"point": [0, 0, 0], "axis": [0, 0, 1]}
    way = [float(np.cos(angle)), float(np.sin(angle)), 0.0]
    return small(
        gravity=[0, 0, -GRAVITY],
        simulation={"step": 1e-3, "horizon": 2.0},
        phases=[{"name": "press", "damping": 20.0}],
        bodies={
            "ground": {"fixed": True},
            "ram": {"mass": 0.5, "inertia": [1e-3, 1e-3, 1e-3], "origin": [0, 0, 0.031]},
        },
        joints={
            "guide": {"type": "prismatic", "guide": {"body": "ground", **guide}, "slider": {"body": "ram", **guide}}
        },
        contacts={
            "touch": {
                "a": {
                    "body": "ram",
                    "cylinder": {"point": [0, 0, 0], "axis": way, "radius": 0.01, "half_length": 0.03},
                },
                "b": {
                    "body": "ground",
                    "cylinder": {"point": [0, 0, 0], "axis": [1, 0, 0], "radius": radius, "half_length": 0.05},
                },
                "friction": 0.2,
            }
        },
        forces={"press": {"body": "ram", "force": [0, 0, -20.0]}},
        responses={
            **coordinates("ram"),
            "force": {"type": "contact_force", "contact": "touch"},
            "gap": {"type": "gap", "contact": "touch"},
        },
    )


@pytest.mark.parametrize("angle", [0.5 * np.pi, 1.0, 0.0])
def test_two_cylinders_in_a_press_carry_its_force(angle):
    """Across each other, inclined and parallel: the force of the ram and its weight, at the sum of the radii."""
    run = simulate(made(crossed(angle)))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(0.03, abs=1e-7)
    assert run.responses["force"] == pytest.approx(20.0 + 0.5 * GRAVITY, rel=1e-6)
    assert abs(run.responses["gap"]) < 1e-7


def test_the_radius_of_a_cylinder_is_a_variable():
    wider = set_values(made(crossed(1.0)), {"contacts.touch.b.cylinder.radius": 0.0205})
    assert simulate(wider).responses["z"] == pytest.approx(0.0305, abs=1e-7)


def in_a_valley(half=0.04):
    """Lay a roller in the valley between two fixed, parallel ones, whose axes are 60 mm apart."""
    roller = {"cylinder": {**ALONG_Y, "radius": 0.02, "half_length": 0.04}}
    sides = {
        name: {
            "a": {"body": "roller", "cylinder": {**ALONG_Y, "radius": 0.02, "half_length": half}},
            "b": {"body": "ground", "cylinder": {**roller["cylinder"], "point": [x, 0, 0]}},
            "friction": 0.0,
        }
        for name, x in (("left", -0.03), ("right", 0.03))
    }
    return small(
        gravity=[0, 0, -GRAVITY],
        simulation={"step": 1e-3, "horizon": 3.0},
        phases=[{"name": "lie", "damping": 10.0}],
        bodies={
            "ground": {"fixed": True},
            "roller": {"mass": 0.3, "inertia": [1e-4, 1e-4, 1e-4], "origin": [0.001, 0, 0.03]},
        },
        contacts=sides,
        responses={
            **coordinates("roller"),
            **{name: {"type": "contact_force", "contact": name} for name in sides},
            "tilt": {"type": "angle", "body": "roller", "axis": [1, 0, 0]},
            "yaw": {"type": "angle", "body": "roller", "axis": [0, 0, 1]},
        },
    )


@pytest.mark.parametrize("half", [0.03, 0.04])
def test_a_roller_lies_in_the_valley_between_two(half):
    """Each carries W / (2 cos a) with sin a = 30 / 40; the lines keep it parallel, also with ends in one plane."""
    run = simulate(made(in_a_valley(half)))
    assert run.status == "ok", run.message
    cosine = np.sqrt(1 - 0.75**2)
    assert run.responses["z"] == pytest.approx(0.04 * cosine, abs=1e-7)
    for side in ("left", "right"):
        assert run.responses[side] == pytest.approx(0.3 * GRAVITY / (2 * cosine), rel=1e-5)
    assert run.responses["tilt"] == pytest.approx(0.0, abs=1e-6)
    assert run.responses["yaw"] == pytest.approx(0.0, abs=1e-6)


def stacked(offset, radius=0.02):
    """Lay a disc on a fixed one of 20 mm, off its middle."""
    disc = {"point": [0, 0, 0], "axis": [0, 0, 1], "half_length": 0.005}
    return small(
        gravity=[0, 0, -GRAVITY],
        simulation={"step": 1e-3, "horizon": 0.3},
        bodies={
            "ground": {"fixed": True},
            "disc": {"mass": 0.1, "inertia": [1e-5, 1e-5, 2e-5], "origin": [offset, 0, 0.01]},
        },
        contacts={
            "lie": {
                "a": {"body": "disc", "cylinder": {**disc, "radius": radius}},
                "b": {"body": "ground", "cylinder": {**disc, "radius": 0.02}},
                "friction": 0.3,
            }
        },
        responses={
            **coordinates("disc"),
            "force": {"type": "contact_force", "contact": "lie"},
            "tilt": {"type": "angle", "body": "disc", "axis": [0, 1, 0]},
        },
    )


@pytest.mark.parametrize(("offset", "radius"), [(0.0, 0.02), (0.0, 0.015), (0.019, 0.02)])
def test_a_disc_lies_on_another(offset, radius):
    """Its weight is over what they have in common, also where their rims coincide."""
    run = simulate(made(stacked(offset, radius)))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(0.01, abs=1e-8)
    assert run.responses["tilt"] == pytest.approx(0.0, abs=1e-7)
    assert run.responses["force"] == pytest.approx(0.1 * GRAVITY, rel=1e-6)


def test_a_disc_tips_over_the_rim_of_another():
    """With its centre of mass d = 1 mm beyond the rim, 5 mm above: m g d / (I + m (d^2 + 5^2)) at first."""
    data = stacked(0.021)
    data["simulation"] |= {"step": 1e-4, "horizon": 0.02}
    data["contacts"]["lie"]["friction"] = 1.0
    run = simulate(made(data), full_horizon=True)
    d2 = 0.001**2 + 0.005**2
    assert run.responses["tilt"] == pytest.approx(0.5 * 0.1 * GRAVITY * 0.001 / (1e-5 + 0.1 * d2) * 0.02**2, rel=0.05)


HALF = (0.03, 0.02, 0.04)


def on_a_slope(slope, friction, under):
    """Lay a box of 60 x 40 x 80 mm on a plane or on a large box, with gravity inclined towards x."""
    box, (a, b, c) = {"centre": [0, 0, 0], "half_lengths": list(HALF)}, np.square(HALF)
    floor = {"plane": FLOOR} if under == "plane" else {"box": {"centre": [0, 0, -0.5], "half_lengths": [2, 2, 0.5]}}
    solid = {"box": box}
    if under == "mesh":
        solid, floor = mesh_of(block(*HALF)), mesh_of(block(2.0, 2.0, 0.5) - (0.0, 0.0, 0.5))
    return small(
        gravity=[GRAVITY * np.sin(slope), 0, -GRAVITY * np.cos(slope)],
        simulation={"step": 1e-3, "horizon": 0.3},
        bodies={
            "ground": {"fixed": True},
            "block": {"mass": 0.6, "inertia": [0.2 * (b + c), 0.2 * (a + c), 0.2 * (a + b)], "origin": [0, 0, HALF[2]]},
        },
        contacts={"lies": {"a": {"body": "block", **solid}, "b": {"body": "ground", **floor}, "friction": friction}},
        responses={
            **coordinates("block"),
            "force": {"type": "contact_force", "contact": "lies"},
            "tilt": {"type": "angle", "body": "block", "axis": [0, 1, 0]},
        },
    )


@pytest.mark.parametrize("under", ["plane", "box", "mesh"])
def test_a_box_slides_down_a_slope(under):
    """Twice as steep as friction: g (sin - mu cos) t^2 / 2, flat, and with its weight across the slope."""
    run = simulate(made(on_a_slope(0.4, 0.2, under)), full_horizon=True)
    expected = 0.5 * GRAVITY * (np.sin(0.4) - 0.2 * np.cos(0.4)) * 0.3**2
    assert run.responses["x"] == pytest.approx(expected, rel=5e-3)
    assert run.responses["force"] == pytest.approx(0.6 * GRAVITY * np.cos(0.4), rel=1e-6)
    assert run.responses["tilt"] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("under", ["plane", "box", "mesh"])
def test_a_box_tips_over_its_edge_where_its_weight_is_beyond(under):
    """It rests up to a slope of 30 / 40; then m g (h sin - b cos) turns it about the edge: 4/3 m (b^2 + h^2)."""
    rests = simulate(made(on_a_slope(np.arctan(0.74), 2.0, under)))
    assert rests.status == "ok", rests.message
    assert abs(rests.responses["tilt"]) < 1e-6
    slope, (b, _, h) = np.arctan(0.9), HALF
    tips = simulate(made(on_a_slope(slope, 2.0, under)), step=2e-4, horizon=0.06, full_horizon=True)
    torque = GRAVITY * (h * np.sin(slope) - b * np.cos(slope))
    assert tips.responses["tilt"] == pytest.approx(torque / (b**2 + h**2) * 0.75 * 0.5 * 0.06**2, rel=0.05)


def piled(turn, upper):
    """Lay two boxes on a fixed one of 60 x 40 x 20 mm, the upper ones turned about z."""
    box = {"centre": [0, 0, 0], "half_lengths": [0.03, 0.02, 0.01]}
    body = {"mass": 0.2, "inertia": [4e-5, 7e-5, 9e-5], "axis": [0, 0, 1]}
    other = {"centre": [0, 0, 0], "half_lengths": upper}
    return small(
        gravity=[0, 0, -GRAVITY],
        simulation={"step": 1e-3, "horizon": 0.5},
        bodies={
            "ground": {"fixed": True},
            "one": {**body, "origin": [0, 0, 0.02], "angle": turn},
            "two": {**body, "origin": [0, 0, 0.04], "angle": 2 * turn},
        },
        contacts={
            "lower": {"a": {"body": "one", "box": box}, "b": {"body": "ground", "box": box}, "friction": 0.4},
            "upper": {"a": {"body": "one", "box": box}, "b": {"body": "two", "box": other}, "friction": 0.4},
        },
        responses={
            **coordinates("two"),
            **{name: {"type": "contact_force", "contact": name} for name in ("lower", "upper")},
            "tilt": {"type": "angle", "body": "two", "axis": [0, 1, 0]},
        },
    )


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.5 * np.pi])
@pytest.mark.parametrize("upper", [[0.03, 0.02, 0.01], [0.05, 0.005, 0.01]])
def test_boxes_that_lie_on_each_other_stay(turn, upper):
    """Of the same size, or a bar on top; in line, turned and across: each carries what is above it."""
    run = simulate(made(piled(turn, upper)))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(0.04, abs=1e-7)
    assert run.responses["tilt"] == pytest.approx(0.0, abs=1e-7)
    assert run.responses["upper"] == pytest.approx(0.2 * GRAVITY, rel=1e-5)
    assert run.responses["lower"] == pytest.approx(0.4 * GRAVITY, rel=1e-5)


def test_the_half_lengths_of_a_box_are_variables():
    data = on_a_slope(0.0, 0.4, "box")
    data["bodies"]["block"]["origin"][2] += 0.001
    longer = set_values(made(data), {"contacts.lies.a.box.half_lengths.2": 0.0405})
    assert simulate(longer).responses["z"] == pytest.approx(0.0405, abs=1e-7)


@pytest.mark.parametrize("under", ["plane", "box"])
def test_static_friction_holds_a_box(under):
    """On a slope of 0.3 a coefficient of 0.2 lets it slide, with 0.4 as long as it sticks it stays."""
    data = on_a_slope(np.arctan(0.3), 0.2, under)
    data["contacts"]["lies"]["static_friction"] = 0.4
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["x"] == pytest.approx(0.0, abs=1e-6)


def test_a_cube_of_a_mesh_rests_in_a_vee():
    """Between two slopes of 30 and 60 degrees without friction each carries the weight's part along its normal."""
    turn, half = np.pi / 6, 0.01
    c, s = np.cos(turn), np.sin(turn)
    cube, rotation = mesh_of(block(half, half, half)), np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    low = (block(0.1, 0.1, 0.05) - (0.0, 0.0, half + 0.05)) @ rotation.T
    steep = (block(0.05, 0.1, 0.1) - (-half - 0.05, 0.0, 0.0)) @ rotation.T
    data = small(
        gravity=[0, 0, -GRAVITY],
        bodies={
            "ground": {"fixed": True},
            "cube": {"mass": 0.5, "inertia": [3e-5] * 3, "axis": [0, 1, 0], "angle": turn},
        },
        contacts={
            name: {"a": {"body": "cube", **cube}, "b": {"body": "ground", **side}, "friction": 0}
            for name, side in (("low", mesh_of(low)), ("steep", mesh_of(steep)))
        },
        responses={
            **coordinates("cube"),
            **{name: {"type": "contact_force", "contact": name} for name in ("low", "steep")},
        },
    )
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["low"] == pytest.approx(0.5 * GRAVITY * c, rel=1e-6)
    assert run.responses["steep"] == pytest.approx(0.5 * GRAVITY * s, rel=1e-6)
    assert [run.responses[axis] for axis in "xyz"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert run.certificate.max_created_energy < 1e-9
