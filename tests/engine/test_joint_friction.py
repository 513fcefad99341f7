"""Friction of ideal joints, which does not depend on their load, and joints that move one way: closed forms."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.assembly import assemble
from engine.errors import MechanismError
from engine.mechanism import set_values
from tests.each import each
from tests.engine.small import GRAVITY, coordinates, made, small, turned

INERTIA, MASS = 0.3, 2.0


def rotor(duration: float | None = None, torque: float = 0.0, spin: float = 0.0, **joint: Any) -> dict[str, Any]:
    """Describe a rotor on an ideal bearing, whose axis is not that of the world's."""
    return small(
        phases=[{"name": "run", "duration": duration}] if duration else [{"name": "settle"}],
        simulation={"horizon": 5.0},
        bodies={
            "base": {"fixed": True, "axis": [0, 0, 1], "angle": 0.7},
            "rotor": {"mass": MASS, "inertia": [1, 1, INERTIA], "angular_velocity": [0, 0, spin]},
        },
        joints={
            "shaft": {
                "type": "revolute",
                "bearing": {"body": "base", "point": [0, 0, 0], "axis": [0, 0, 1]},
                "journal": {"body": "rotor", "point": [0, 0, 0], "axis": [0, 0, 1]},
                **joint,
            }
        },
        torques={"t": {"body": "rotor", "torque": [0, 0, torque]}},
        responses={
            "angle": {"type": "angle", "body": "rotor", "axis": [0, 0, 1]},
            "speed": {"type": "angular_velocity", "body": "rotor", "axis": [0, 0, 1]},
        },
    )


def rubbing(data: dict[str, Any], contact: str) -> dict[str, Any]:
    """Measure the friction of a joint too."""
    data["responses"] |= {
        "friction": {"type": "contact_force", "contact": contact},
        "taken": {"type": "friction_work", "contact": contact},
    }
    return data


def test_a_rotor_slows_down_linearly_and_stays():
    """From 4 rad/s against 0.6 N m: after w I / M = 2 s and w^2 I / 2 M = 4 rad, with all its energy taken."""
    data = rubbing(rotor(spin=4.0, friction_torque=0.6), "shaft.friction_torque")
    data["responses"]["stop"] = {"type": "time", "at": {"response": "speed", "below": 1e-9}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["speed"] == pytest.approx(0.0, abs=1e-10)
    assert run.responses["angle"] == pytest.approx(4.0, rel=1e-6)
    assert run.responses["stop"] == pytest.approx(2.0, abs=2e-3)
    assert run.responses["taken"] == pytest.approx(0.5 * INERTIA * 4.0**2, rel=1e-6)
    assert run.certificate.created_energy < 1e-9
    assert run.certificate.lost_energy < 1e-9
    halfway = simulate(made(rubbing(rotor(1.0, spin=4.0, friction_torque=0.6), "shaft.friction_torque")))
    assert halfway.responses["speed"] == pytest.approx(2.0, rel=1e-9)
    assert halfway.responses["friction"] == pytest.approx(0.6, rel=1e-9)


@pytest.mark.parametrize(("torque", "speed"), [(0.5, 0.0), (-0.5, 0.0), (0.9, 1.0), (-0.9, -1.0)])
def test_a_torque_below_the_friction_moves_nothing(torque, speed):
    """Above it the rotor gains (M - M_f) t / I; below it, friction is what the torque is."""
    run = simulate(made(rubbing(rotor(1.0, torque, friction_torque=0.6), "shaft.friction_torque")))
    assert run.responses["speed"] == pytest.approx(speed, rel=1e-7, abs=1e-15)
    assert run.responses["angle"] == pytest.approx(speed / 2, rel=1e-3, abs=1e-15)
    assert run.responses["friction"] == pytest.approx(min(abs(torque), 0.6), rel=1e-7)


def sliding(type_: str, friction: float, **tables: Any) -> dict[str, Any]:
    """Describe a slider on a vertical guide."""
    first, second = ("guide", "slider") if type_ == "prismatic" else ("bearing", "journal")
    data = small(
        gravity=[0, 0, -GRAVITY],
        phases=[{"name": "run", "duration": 0.5}],
        bodies={"ground": {"fixed": True}, "load": {"mass": MASS, "inertia": [1, 1, 1], "origin": [0, 0, 0.1]}},
        joints={
            "slide": {
                "type": type_,
                first: {"body": "ground", "point": [0, 0, 0], "axis": [0, 0, 1]},
                second: {"body": "load", "point": [0, 0, 0], "axis": [0, 0, 1]},
                "friction_force": friction,
            }
        },
        responses=coordinates("load"),
    )
    return rubbing({**data, **tables}, "slide.friction_force")


@each("type_", ["prismatic", "cylindrical"])
def test_a_slider_holds_its_weight_or_slides_with_what_is_left(type_):
    """A campaign may vary the bound; turned elsewhere all is the same."""
    weight = MASS * GRAVITY
    holds = simulate(made(sliding(type_, 1.01 * weight)))
    assert holds.responses["z"] == pytest.approx(0.1, abs=1e-10)
    assert holds.responses["friction"] == pytest.approx(weight, rel=1e-7)
    assert holds.responses["taken"] == pytest.approx(0.0, abs=1e-9)
    data = sliding(type_, 1.01 * weight)
    slides = simulate(set_values(made(data), {"joints.slide.friction_force": 0.75 * weight}))
    way = 0.25 * GRAVITY * 0.5**2 / 2
    assert slides.responses["z"] == pytest.approx(0.1 - way, rel=1e-7)
    assert slides.responses["taken"] == pytest.approx(0.75 * weight * way, rel=1e-7)
    data["joints"]["slide"]["friction_force"] = 0.75 * weight
    there = simulate(made(turned(data, Rotation.from_rotvec([0.3, -1.0, 0.7]), np.array([3.0, -2.0, 1.0]))))
    assert there.responses["taken"] == pytest.approx(slides.responses["taken"], rel=1e-7)


def test_forces_at_rest_know_the_friction():
    """A load on a stop, with friction on its guide: at rest the two share the weight as equally stiff ones do."""
    data = sliding("prismatic", 5.0, phases=[{"name": "settle"}])
    data["simulation"]["horizon"] = 3.0
    data["joints"]["slide"]["limits"] = {"lower": 0.05}
    data["responses"]["stop"] = {"type": "contact_force", "contact": "slide.lower"}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["stop"] + run.responses["friction"] == pytest.approx(MASS * GRAVITY, rel=1e-6)
    assert run.responses["friction"] <= 5.0 * (1 + 1e-6)


def test_a_motion_works_against_the_friction():
    """A drive at constant speed needs the friction's force, and does its work."""
    data = sliding("prismatic", 3.0, gravity=[0, 0, 0])
    data["motions"] = {"drive": {"body": "load", "along": {"direction": [0, 0, 1]}, "law": {"speed": 0.2}}}
    data["responses"] |= {
        "force": {"type": "motion_force", "motion": "drive"},
        "work": {"type": "motion_work", "motion": "drive"},
    }
    run = simulate(made(data))
    assert run.responses["force"] == pytest.approx(3.0, rel=1e-9)
    assert run.responses["taken"] == pytest.approx(0.3, rel=1e-2)
    assert run.responses["work"] == pytest.approx(0.3, rel=2e-2) or run.responses["work"] > 0.3


@pytest.mark.parametrize(("way", "speed"), [("forward", 1.0), ("backward", 0.0)])
def test_a_joint_that_moves_one_way_locks_the_other(way, speed):
    """Against 0.3 N m for 1 s: free it gains 1 rad/s, locked it carries the torque."""
    data = rotor(1.0, 0.3, one_way=way)
    data["responses"]["clutch"] = {"type": "contact_force", "contact": "shaft.one_way"}
    run = simulate(made(data))
    assert run.responses["speed"] == pytest.approx(speed, rel=1e-7, abs=1e-12)
    assert run.responses["clutch"] == pytest.approx(0.0 if speed else 0.3, rel=1e-6)


def test_what_sticks_breaks_away_at_more_than_what_slides():
    """A torque that grows by 0.5 N m/s breaks away at 0.9 N m after 1.8 s, and then has 0.6 N m against it."""
    data = rotor(2.4, friction_torque=0.6, breakaway_torque=0.9)
    data["torques"]["t"] = {"body": "rotor", "torque": [0, 0, 1], "law": {"table": [[0, 0], [4, 2]]}}
    data["responses"]["breaks"] = {"type": "time", "at": {"response": "speed", "above": 1e-6}}
    data["responses"]["friction"] = {"type": "contact_force", "contact": "shaft.friction_torque"}
    data["responses"]["most"] = {**data["responses"]["friction"], "at": "maximum"}
    run = simulate(made(data))
    assert run.responses["breaks"] == pytest.approx(1.8, abs=2e-3)
    assert run.responses["most"] == pytest.approx(0.9, rel=2e-3)
    assert run.responses["friction"] == pytest.approx(0.6, rel=1e-7)
    assert run.responses["speed"] == pytest.approx((0.3 * 0.6 + 0.25 * 0.6**2) / INERTIA, rel=5e-3)
    held = simulate(
        made(rubbing(rotor(torque=0.8, friction_torque=0.6, breakaway_torque=0.9), "shaft.friction_torque"))
    )
    assert held.status == "ok", held.message
    assert held.responses["friction"] == pytest.approx(0.8, rel=1e-6)


def test_a_spring_pulls_a_block_in_jumps():
    """Stick-slip with 200 N/m at 0.1 m/s: its force swings about the sliding 4 N, from 8 N until the block stands."""
    data = sliding("prismatic", 4.0, gravity=[0, 0, 0], phases=[{"name": "run", "duration": 2.0}])
    data["simulation"]["horizon"] = 2.0
    data["joints"]["slide"]["breakaway_force"] = 8.0
    data["bodies"]["sled"] = {"mass": 1.0, "inertia": [1, 1, 1], "origin": [0, 0, 1.1]}
    data["joints"]["lead"] = {
        "type": "prismatic",
        "guide": {"body": "ground", "point": [0, 0, 0], "axis": [0, 0, 1]},
        "slider": {"body": "sled", "point": [0, 0, 0], "axis": [0, 0, 1]},
    }
    data["motions"] = {"pull": {"body": "sled", "along": {"direction": [0, 0, 1]}, "law": {"speed": 0.1}}}
    ends = {"a": {"body": "load", "point": [0, 0, 0]}, "b": {"body": "sled", "point": [0, 0, 0]}}
    data["springs"] = {"s": {"type": "linear", **ends, "stiffness": 200.0, "free_length": 1.0}}
    force = {"type": "spring_force", "spring": "s"}
    data["phases"] = [{"name": "first", "duration": 0.45}, {"name": "later", "duration": 1.55}]
    data["responses"] = {"most": {**force, "at": "minimum"}, "least": {**force, "at": "maximum", "from_phase": "later"}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    swing = np.hypot(4.0, 0.1 * np.sqrt(200.0 * MASS))  # the sled goes on while the block slides
    assert run.responses["most"] == pytest.approx(-4.0 - swing, rel=5e-3)
    assert run.responses["least"] == pytest.approx(-4.0 + swing, abs=5e-2)


def fault(data: dict[str, Any]) -> str:
    """Return the message of the one fault of a mechanism."""
    with pytest.raises(MechanismError) as caught:
        assemble(made(data))
    return str(caught.value).split("\n")[1].strip()


def test_what_makes_no_sense_is_refused():
    """Each message begins with the key."""
    assert fault(rotor(friction_torque=-1.0)).startswith("joints.shaft.friction_torque = -1")
    assert "friction_force" in fault(rotor(friction_force=1.0))
    weak = rotor(friction_torque=0.6, breakaway_torque=0.5)
    assert fault(weak).startswith("joints.shaft.breakaway_torque = 0.5")
    assert "friction_torque, which is 0.6" in fault(weak)
    loose = rotor(friction_torque=0.1)
    loose["joints"]["shaft"] |= {"type": "clearance_revolute", "rings": [0], "radial_clearance": 1e-3, "friction": 0}
    loose["joints"]["shaft"]["journal"]["radius"] = 0.01
    assert "give `friction`, the coefficient of its faces" in fault(loose)
