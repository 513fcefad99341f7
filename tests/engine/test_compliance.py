"""Contacts and stops with a stiffness: closed forms, the energy account, and steps of any length."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.errors import MechanismError
from engine.mechanism import set_values
from tests.each import each
from tests.engine.small import FLOOR, GRAVITY, block_on_floor, coordinates, made, small, turned

MASS, STIFF = 2.0, 5000.0
OMEGA = np.sqrt(STIFF / MASS)


def falling(height: float = 0.0, speed: float = 0.0, duration: float | None = None, **contact: Any) -> dict[str, Any]:
    """Describe a ball on a springy floor, without gravity if it has a speed."""
    return small(
        gravity=[0, 0, 0 if speed else -GRAVITY],
        phases=[{"name": "run", "duration": duration}] if duration else [{"name": "settle"}],
        simulation={"horizon": 200.0, "step": 5e-4},
        bodies={
            "ground": {"fixed": True},
            "ball": {"mass": MASS, "inertia": [1, 1, 1], "origin": [0, 0, height], "velocity": [0, 0, -speed]},
        },
        contacts={
            "floor": {
                "a": {"body": "ball", "point": [0, 0, 0]},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": 0.0,
                "stiffness": STIFF,
                **contact,
            }
        },
        responses={
            **coordinates("ball"),
            "force": {"type": "contact_force", "contact": "floor"},
            "peak": {"type": "contact_force", "contact": "floor", "at": "maximum"},
            "deep": {"type": "gap", "contact": "floor", "at": "minimum"},
            "speed": {
                "type": "velocity",
                "to": {"body": "ball", "point": [0, 0, 0]},
                "direction": {"vector": [0, 0, 1]},
            },
        },
    )


def test_a_ball_bounces_as_on_a_spring():
    """It is pressed v sqrt(m / k) deep by v sqrt(m k) and leaves with its speed after pi sqrt(m / k): second order."""
    data = falling(speed=1.0, duration=0.1)
    data["responses"]["left"] = {"type": "time", "at": {"response": "z", "above": 1e-9}}
    missing = []
    for step in (5e-4, 2.5e-4):
        data["simulation"]["step"] = step
        run = simulate(made(data))
        assert run.status == "ok", run.message
        assert run.responses["deep"] == pytest.approx(-1.0 / OMEGA, rel=1e-3)
        assert run.responses["peak"] == pytest.approx(MASS * OMEGA, rel=1e-3)
        assert run.responses["left"] == pytest.approx(np.pi / OMEGA, abs=step)
        assert run.certificate.created_energy < 1e-8
        assert run.certificate.max_penetration <= 1e-8
        assert not run.at_impact
        missing.append(1.0 - run.responses["speed"])
    assert 0.0 < missing[0] < 1e-3
    assert missing[0] > 3.0 * missing[1]


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_damping_takes_what_it_takes_of_an_oscillator(share):
    """The damper pushes until spring and damper together would pull: m x'' + d x' + k x = 0 until d x' + k x = 0."""
    damping, damped = 2 * share * MASS * OMEGA, OMEGA * np.sqrt(1 - share**2)
    data = falling(speed=1.0, duration=0.15, damping=damping)
    data["simulation"]["step"] = 2e-4

    def rate(t):
        return np.exp(-share * OMEGA * t) * (np.cos(damped * t) - share * OMEGA / damped * np.sin(damped * t))

    def force(t):
        return STIFF * np.exp(-share * OMEGA * t) * np.sin(damped * t) / damped + damping * rate(t)

    leaves = brentq(force, 0.5 * np.pi / damped, np.pi / damped)
    run = simulate(made(data))
    assert run.responses["speed"] == pytest.approx(-rate(leaves), rel=5e-3)
    assert run.certificate.created_energy < 1e-8


@pytest.mark.parametrize("step", [5e-4, 0.05, 1.0])
def test_a_load_rests_on_its_spring_whatever_the_step(step):
    """It comes to rest m g / k deep, also with steps of 8 periods, and the floor reports its weight."""
    data = falling(0.1, damping=20.0)
    data["simulation"] |= {"step": step, "rest": {"window": max(0.5, 4 * step), "drift": 1e-7}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(-MASS * GRAVITY / STIFF, abs=1e-7)
    assert run.responses["force"] == pytest.approx(MASS * GRAVITY, rel=1e-4)
    assert run.certificate.created_energy < 1e-7


def pressed(friction: float, overlap: float = 1e-3, duration: float | None = None) -> dict[str, Any]:
    """Describe a block that two jaws press, its weight along them."""
    jaws = {
        side: {
            "a": {"body": "ball", "point": [x, 0, 0]},
            "b": {"body": "ground", "plane": {"point": [x, 0, 0], "normal": [-np.sign(x), 0, 0]}},
            "offset": overlap,
            "stiffness": STIFF,
            "friction": friction,
        }
        for side, x in (("left", -0.1), ("right", 0.1))
    }
    data = falling(duration=duration)
    data["contacts"] = jaws
    data["joints"] = {
        "guide": {
            "type": "planar",
            "a": {"body": "ground", "point": [0, 0, 0], "normal": [0, 1, 0]},
            "b": {"body": "ball", "point": [0, 0, 0], "normal": [0, 1, 0]},
        }
    }
    data["responses"] = coordinates("ball") | {
        side: {"type": "contact_force", "contact": side} for side in ("left", "right")
    }
    return data


def test_a_press_fit_holds_or_slips_with_its_interference():
    """Two forces of stiffness times overlap, 5 N each: with friction they hold the weight, or let the block fall."""
    weight, force = MASS * GRAVITY, STIFF * 1e-3
    holds = simulate(made(pressed(2.5)))
    assert holds.status == "ok", holds.message
    assert holds.responses["left"] == pytest.approx(force, rel=1e-5)
    assert holds.responses["right"] == pytest.approx(force, rel=1e-5)
    assert holds.responses["z"] == pytest.approx(0.0, abs=1e-8)
    slips = simulate(made(pressed(1.5, duration=0.2)))
    assert slips.responses["z"] == pytest.approx(-0.5 * (weight - 2 * 1.5 * force) / MASS * 0.2**2, rel=1e-6)
    tighter = simulate(set_values(made(pressed(1.5)), {f"contacts.{s}.offset": 2e-3 for s in ("left", "right")}))
    assert tighter.responses["left"] == pytest.approx(2 * force, rel=1e-5)
    there = simulate(made(turned(pressed(2.5), Rotation.from_rotvec([0.3, -1.0, 0.7]), np.array([3.0, -2.0, 1.0]))))
    assert there.responses["left"] == pytest.approx(force, rel=1e-5)


def test_a_jaw_with_two_stiffnesses_finds_its_middle():
    """Springs of k and 3 k with 1 mm of overlap each: it moves half a mm to the soft one; both press 3/2 mm x k."""
    data = pressed(0.0)
    data["contacts"]["right"]["stiffness"] = 3 * STIFF
    for side in ("left", "right"):
        data["contacts"][side]["damping"] = 50.0
    data["gravity"] = [0, 0, 0]
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["x"] == pytest.approx(-0.5e-3, abs=2e-7)
    assert run.responses["left"] == pytest.approx(1.5e-3 * STIFF, rel=1e-3)


@each("stiffness", [1e4, 1e6, 1e9])
def test_a_brick_that_tumbles_creates_no_energy(stiffness):
    """Eight corners with friction and stiffness, resolved by the steps or not; it ends where its weight lets it."""
    data = block_on_floor(
        friction=0.3,
        origin=[0, 0, 0.4],
        axis=[1, 2, 0.5],
        angle=0.6,
        velocity=[0.5, -0.3, -1],
        angular_velocity=[1, 2, -0.5],
    )
    for contact in data["contacts"].values():
        del contact["restitution"]
        contact |= {"stiffness": stiffness, "damping": 20.0}
    data["simulation"] |= {"horizon": 20.0, "step": 1e-3}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.certificate.created_energy < 1e-3 * run.certificate.max_kinetic_energy
    assert min(abs(run.responses["z"] + 2.0 * GRAVITY / 4 / stiffness - half) for half in (0.1, 0.2, 0.3)) < 1e-5


@pytest.mark.parametrize("type_", ["prismatic", "revolute"])
def test_a_stop_of_a_joint_may_be_a_spring(type_):
    """A slider, or a rotor, with a speed of 1 is pressed by sqrt(m k), as its stop's force or torque."""
    names = ("guide", "slider") if type_ == "prismatic" else ("bearing", "journal")
    sides = {
        name: {"body": body, "point": [0, 0, 0], "axis": [0, 0, 1]}
        for name, body in zip(names, ("ground", "rotor"), strict=True)
    }
    speed = {"velocity": [0, 0, 1]} if type_ == "prismatic" else {"angular_velocity": [0, 0, 1]}
    data = small(
        phases=[{"name": "run", "duration": 0.2}],
        simulation={"step": 2e-4},
        bodies={"ground": {"fixed": True}, "rotor": {"mass": MASS, "inertia": [1, 1, MASS], **speed}},
        joints={
            "shaft": {
                "type": type_,
                **{
                    s: {"body": b, "point": [0, 0, 0], "axis": [0, 0, 1]}
                    for s, b in zip(sides, ("ground", "rotor"), strict=True)
                },
                "limits": {"lower": -0.1, "upper": 0.05, "stiffness": STIFF},
            }
        },
        responses={"peak": {"type": "contact_force", "contact": "shaft.upper", "at": "maximum"}},
    )
    run = simulate(made(data))
    assert run.responses["peak"] == pytest.approx(MASS * OMEGA, rel=2e-3)
    assert run.certificate.created_energy < 1e-8


@each(
    ("change", "named"),
    [
        ({"stiffness": None, "damping": 1.0}, "contacts.floor.damping"),
        ({"restitution": 0.5}, "contacts.floor.restitution"),
        ({"stiffness": 0.0}, "contacts.floor.stiffness"),
        ({"damping": -1.0}, "contacts.floor.damping"),
    ],
)
def test_what_no_such_contact_can_have_is_refused(change, named):
    contact = falling(**change)
    contact["contacts"]["floor"] = {k: v for k, v in contact["contacts"]["floor"].items() if v is not None}
    with pytest.raises(MechanismError, match=named):
        made(contact)


def test_the_plain_scheme_has_rigid_contacts_only():
    data = falling()
    data["simulation"]["scheme"] = "moreau_jean"
    with pytest.raises(MechanismError, match=r"contacts\.floor\.stiffness"):
        made(data)
