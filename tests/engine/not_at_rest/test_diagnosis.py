"""What a run says that did not come to rest, for mechanisms whose motion is known in closed form."""

import math
import re
from typing import Any

import numpy as np
import pytest

from engine import Run, simulate
from tests.engine.small import GRAVITY, block_on_floor, coordinates, made, small

GROUND = {"fixed": True}
BALL = {"mass": 2.0, "inertia": [1e-3, 1e-3, 1e-3]}
GUIDE = {"point": [0, 0, 0], "axis": [1, 0, 0]}
SLIDE = {"type": "prismatic", "guide": {"body": "ground", **GUIDE}, "slider": {"body": "ball", **GUIDE}}
ENDS = {"a": {"body": "ground", "point": [-1, 0, 0]}, "b": {"body": "ball", "point": [0, 0, 0]}}


def on_a_guide(horizon: float = 1.0, step: float = 1e-3, body: Any = None, **tables: Any) -> Run:
    """Run a ball that an ideal guide leaves one way to go, x."""
    data = small(
        bodies={"ground": GROUND, "ball": {**BALL, **(body or {})}},
        joints={"J": SLIDE},
        responses={"x": coordinates("ball")["x"]},
        simulation={"horizon": horizon, "step": step},
        **tables,
    )
    return simulate(made(data))


def number(pattern: str, message: str) -> float:
    """Return the number that a message has at the place of the pattern's group."""
    found = re.search(pattern, message)
    assert found, message
    return float(found[1])


def pin_in_a_bore(play: float = 1e-3, gravity: Any = (0, -GRAVITY, 0), **body: Any) -> dict[str, Any]:
    """Describe a pin without friction in a bore along z, between two flat stops with play."""
    line = {"point": [0, 0, 0], "axis": [0, 0, 1]}
    pin = {"mass": 0.1, "inertia": [1e-5, 1e-5, 1e-6], **body}
    joint = {
        "type": "clearance_cylindrical",
        "bearing": {"body": "ground", **line},
        "journal": {"body": "pin", **line, "radius": 5e-3},
        "rings": [-0.01, 0.01],
        "radial_clearance": 1e-4,
        "friction": 0.0,
    }
    stops = {
        name: {
            "a": {"body": "pin", "point": [0, 0, 0.02 * side]},
            "b": {"body": "ground", "plane": {"point": [0, 0, side * (0.02 + play)], "normal": [0, 0, -side]}},
            "friction": 0.0,
        }
        for name, side in (("upper", 1), ("lower", -1))
    }
    return small(
        gravity=list(gravity),
        bodies={"ground": GROUND, "pin": pin},
        joints={"J": joint},
        contacts=stops,
        responses={"z": coordinates("pin")["z"]},
    )


def test_a_block_on_a_steep_slope_slides_faster_and_faster():
    """Turned gravity of 40 degrees, friction 0.5: it slides along +x at g (sin - mu cos) t."""
    data = block_on_floor(friction=0.5, origin=[0, 0, 0.1])
    angle = math.radians(40)
    data["gravity"] = [GRAVITY * math.sin(angle), 0, -GRAVITY * math.cos(angle)]
    run = simulate(made(data))
    assert (run.status, run.responses) == ("not_at_rest", {})
    assert run.message.startswith("not at rest at the horizon of 1 s: block slides along +x at ")
    assert number(r"at ([\d.]+) m/s", run.message) == pytest.approx(
        GRAVITY * (math.sin(angle) - 0.5 * math.cos(angle)), rel=2e-3
    )
    assert "it gets faster and faster, and nothing holds it" in run.message
    assert "no load" not in run.message


def test_a_pin_floats_in_its_axial_play():
    """Gravity presses it into the bore, nothing acts along the axis: it floats on at the speed it has."""
    run = simulate(made(pin_in_a_bore(play=10.0, velocity=[0, 0, -2e-3])))
    assert run.status == "not_at_rest"
    assert "pin floats along -z, the axis of J at 0.002 m/s; no load acts on it in this direction" in run.message
    assert "duration" in run.message


def test_an_oscillator_that_nothing_damps():
    """Its message has the period, the largest speed, and that no energy is lost."""
    springs = {"s": {"type": "linear", **ENDS, "stiffness": 200.0, "free_length": 1.0}}
    run = on_a_guide(horizon=2.0, body={"velocity": [0.3, 0, 0]}, springs=springs)
    assert run.status == "not_at_rest"
    assert "ball swings along x, the axis of J at up to 0.3 m/s" in run.message
    assert number(r"period is ([\d.]+) s", run.message) == pytest.approx(2 * math.pi / 10, rel=2e-3)
    assert "next to nothing damps it" in run.message
    assert "raise simulation.horizon" not in run.message


def test_an_oscillator_that_a_damper_slows_names_a_horizon_that_does():
    """Lightly damped: it keeps exp(-c T / 2 m) in a period, and with the horizon it names the run comes to rest."""
    springs = {"s": {"type": "linear", **ENDS, "stiffness": 200.0, "free_length": 1.0, "damping": 4.0}}
    body = {"velocity": [0.3, 0, 0]}
    run = on_a_guide(body=body, springs=springs)
    period = 2 * math.pi / math.sqrt(100 - 1)
    assert number(r"loses ([\d.]+) %", run.message) == pytest.approx(100 * (1 - math.exp(-period)), rel=0.1)
    longer = on_a_guide(
        horizon=number(r"raise simulation.horizon to ([\d.]+)", run.message), body=body, springs=springs
    )
    assert longer.status == "ok", longer.message


def test_a_part_that_creeps():
    """A force on a damper: the speed is F / c, far below what is seen, and does not change."""
    dampers = {"d": {"type": "linear", **ENDS, "damping": 400.0}}
    run = on_a_guide(forces={"f": {"body": "ball", "force": [0.01, 0, 0]}}, dampers=dampers)
    assert run.status == "not_at_rest"
    assert "ball slides along +x, the axis of J at 2.5e-05 m/s; its speed does not change" in run.message


def test_a_part_that_slows_down_names_a_horizon_that_does():
    """A drag in proportion to the speed: v0 exp(-c t) reaches drift / window at a time that the message knows."""
    body = {"velocity": [1.0, 0, 0]}
    short = on_a_guide(body=body, phases=[{"name": "run", "damping": 2.0}])
    assert "it slows down" in short.message
    expected = math.log(0.05 / 1e-7) / 2.0
    assert number(r"come to rest at about ([\d.]+) s", short.message) == pytest.approx(expected, rel=0.02)
    horizon = number(r"raise simulation.horizon to ([\d.]+)", short.message)
    assert on_a_guide(horizon=horizon, body=body, phases=[{"name": "run", "damping": 2.0}]).status == "ok"


def test_what_comes_to_rest_a_little_later_is_continued_until_it_does():
    """A block that friction stops after v / (mu g) = 0.51 s, at a horizon of 0.4 s."""
    data = block_on_floor(friction=0.4, origin=[0, 0, 0.1], velocity=[2.0, 0, 0])
    data["simulation"]["horizon"] = 0.4
    run = simulate(made(data))
    rest = number(r"it comes to rest at about ([\d.]+) s", run.message)
    assert rest == pytest.approx(2.0 / (0.4 * GRAVITY) + 0.05, abs=0.01)
    assert run.measured["x"] == pytest.approx(2.0 * 0.4 - 0.5 * 0.4 * GRAVITY * 0.4**2, abs=1e-3)
    assert run.certificate.time == pytest.approx(0.4)


def test_a_body_turns_about_the_axis_of_its_joint():
    """A lever on a hinge away from its centre of mass, which nothing slows: it turns, it does not slide."""
    hinge = {"point": [0, 0, 0], "axis": [0, 1, 0]}
    lever = {"mass": 1.0, "inertia": [0.01, 0.02, 0.02], "center_of_mass": [0.3, 0, 0]}
    spin = 3.0
    lever |= {"angular_velocity": [0, spin, 0], "velocity": [0, 0, -0.3 * spin]}
    joint = {"type": "revolute", "bearing": {"body": "ground", **hinge}, "journal": {"body": "lever", **hinge}}
    angle = {"type": "angle", "body": "lever", "axis": [0, 1, 0]}
    run = simulate(
        made(small(bodies={"ground": GROUND, "lever": lever}, joints={"hinge": joint}, responses={"angle": angle}))
    )
    assert "lever turns about y, the axis of hinge at 3 rad/s; no load acts on it" in run.message


def test_the_body_that_is_measured_is_named_and_not_one_that_may_move():
    """A loose ball flies by faster than the block slides: it keeps nothing from rest."""
    data = block_on_floor(friction=0.0, origin=[0, 0, 0.1], velocity=[0.5, 0, 0])
    data["bodies"]["loose"] = {**BALL, "origin": [0, 0, 9], "velocity": [50.0, 0, 0]}
    run = simulate(made(data))
    assert "block floats along +x at 0.5 m/s" in run.message
    assert "loose" not in run.message


def test_a_step_too_long_for_a_damper_is_named_with_one_that_does():
    """With c h / m = 3 each step turns the speed round and doubles it; with half the step it comes to rest."""
    dampers = {"d": {"type": "linear", **ENDS, "damping": 6000.0}}
    run = on_a_guide(horizon=0.03, body={"velocity": [1e-3, 0, 0]}, dampers=dampers)
    assert run.status == "not_at_rest"
    assert "ball trembles along x, the axis of J at up to" in run.message
    assert "the step of 0.001 s is too long: with 0.0005 s it comes to rest" in run.message
    assert on_a_guide(horizon=0.2, step=5e-4, body={"velocity": [1e-3, 0, 0]}, dampers=dampers).status == "ok"


def in_a_notch(horizon: float, x: float = 0.0) -> Run:
    """Let a ball without friction fall into a round groove that is narrower, so that it rests on both edges."""
    arc = {"to": [-0.4, 0], "centre": [0, 0], "turn": "right"}
    profile = [{"to": [5, -3]}, {"to": [5, 0]}, {"to": [0.4, 0]}, arc, {"to": [-5, 0]}]
    notch = {"point": [0, -0.59, 0], "axis": [0, 0, 1], "along": [1, 0, 0], "start": [-5, -3], "profile": profile}
    data = small(
        gravity=[0, -GRAVITY, 0],
        bodies={"ground": GROUND, "ball": {**BALL, "origin": [x, 0.0, 0.0]}},
        contacts={
            "notch": {
                "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": 0.5}},
                "b": {"body": "ground", "extruded": notch},
                "friction": 0.0,
            }
        },
        responses=coordinates("ball"),
        simulation={"horizon": horizon},
    )
    return simulate(made(data))


@pytest.mark.parametrize(("horizon", "x"), [(1.0, 0.1), (0.2, 0.0)])
def test_a_part_that_gets_nowhere_between_two_flanks_is_no_free_motion(horizon: float, x: float):
    """It has a steady speed that each projection undoes; or it reaches the notch only after the horizon."""
    run = in_a_notch(horizon, x)
    assert run.status == "not_at_rest"
    assert "ball trembles along" in run.message, run.message
    assert "contact notch would have to hold at two places at once" in run.message


def in_a_groove(**sides: Any) -> Run:
    """Drop a ball into a V-groove, each side of which is given as a primitive of the ground, by name."""
    ball = {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": 0.005}}
    level = {"point": [0, 0, 0], "normal": [0, 1, 0]}
    contacts = {
        name: {"a": ball, "b": {"body": "ground", **side}, "friction": 0.2, "restitution": 0.0}
        for name, side in sides.items()
    }
    return simulate(
        made(
            small(
                simulation={"step": 1e-4, "adaptive": {"longest": 4e-3, "travel": 2e-4}},
                gravity=[0, 0, -GRAVITY],
                bodies={
                    "ground": {"fixed": True},
                    "ball": {"mass": 0.004, "inertia": [4e-8] * 3, "origin": [1e-3, 0, 0.02]},
                },
                joints={"plane": {"type": "planar", "a": {"body": "ground", **level}, "b": {"body": "ball", **level}}},
                contacts=contacts,
                responses=coordinates("ball"),
            )
        )
    )


def test_one_contact_that_has_to_hold_at_two_places_is_named():
    """A ball in a cone, which touches it all round, never rests, however short the step; between two planes it does."""
    profile = [{"to": [0.05, 0.035]}, {"to": [0.05, -0.05]}, {"to": [0, -0.05]}]
    solid = {"point": [0, 0, 0], "axis": [0, 0, 1]}
    run = in_a_groove(groove={"turned": {**solid, "start": [0, 0], "profile": profile}})
    assert run.status == "not_at_rest"
    assert "trembles about y" in run.message
    assert "contact groove would have to hold at two places at once" in run.message
    assert "it needs a contact for each, such as two planes in place of a groove" in run.message
    planes = {
        name: {"plane": {"point": [0, 0, 0], "normal": [x, 0, 0.05]}}
        for name, x in (("left", 0.035), ("right", -0.035))
    }
    run = in_a_groove(**planes)
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(0.005 * math.hypot(0.05, 0.035) / 0.05, abs=1e-9)


def test_a_rest_that_no_force_holds_is_not_rest():
    """Drift and horizon so coarse that a block that has only begun to slide counts as unmoved: its forces tell."""
    data = block_on_floor(friction=0.1, origin=[0, 0, 0.1])
    data["gravity"] = [GRAVITY * math.sin(0.5), 0, -GRAVITY * math.cos(0.5)]
    data["simulation"] |= {"horizon": 5e-3, "rest": {"window": 2e-3, "drift": 1e-3}}
    data["responses"]["force"] = {"type": "contact_force", "contact": "corner_0"}
    run = simulate(made(data))
    assert run.status == "not_at_rest"
    assert "no contact forces hold the pose: block slides along +x;" in run.message
    assert "give it more time (simulation.horizon" in run.message
    assert run.certificate.settled
    assert run.certificate.time == pytest.approx(5e-3)


def test_the_message_is_a_function_of_the_run():
    """Word by word the same, with a recording or without."""
    body = {"velocity": [1.0, 0, 0]}
    messages = {on_a_guide(body=body).message for _ in range(2)}
    assert len(messages) == 1
    assert np.isfinite(on_a_guide(body=body).measured["x"])
