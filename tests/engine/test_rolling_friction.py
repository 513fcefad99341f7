"""What resists rolling and spinning: closed forms, the energy account, and what it leaves alone."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine import read_trajectory, simulate
from engine.assembly import assemble
from engine.errors import MechanismError
from engine.mechanism import set_values, settable_keys
from tests.each import each
from tests.engine.small import FLOOR, GRAVITY, coordinates, made, small, turned

MASS, RADIUS, ARM = 0.5, 0.02, 0.001
INERTIA = 0.4 * MASS * RADIUS**2


def ball(slope: float = 0.0, duration: float | None = None, step: float = 1e-3, **contact: Any) -> dict[str, Any]:
    """Describe a ball on a floor, with gravity inclined to it by an angle towards x."""
    return small(
        gravity=[GRAVITY * np.sin(slope), 0, -GRAVITY * np.cos(slope)],
        phases=[{"name": "run", "duration": duration}] if duration else [{"name": "run"}],
        simulation={"step": step, "horizon": 10.0},
        bodies={
            "ground": {"fixed": True},
            "ball": {"mass": MASS, "inertia": [INERTIA] * 3, "origin": [0, 0, RADIUS]},
        },
        contacts={
            "touch": {
                "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": RADIUS}},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": 0.5,
                "rolling_friction": ARM,
                **contact,
            }
        },
        responses={
            **coordinates("ball"),
            "force": {"type": "contact_force", "contact": "touch"},
            "spin": {"type": "angle", "body": "ball", "axis": [0, 0, 1]},
        },
    )


def rolled(data: dict[str, Any], speed: float) -> dict[str, Any]:
    """Let the ball roll along x."""
    data["bodies"]["ball"] |= {"velocity": [speed, 0, 0], "angular_velocity": [0, speed / RADIUS, 0]}
    return data


@each(("share", "rolls"), [(0.99, False), (1.01, True)])
def test_a_ball_rolls_from_the_angle_whose_tangent_is_arm_over_radius(share, rolls):
    """Above it with m g (sin - cos ARM / R) over the inertia that rolls, 7/5 m; below it rests, with forces at rest."""
    slope = float(np.arctan(share * ARM / RADIUS))
    run = simulate(made(ball(slope, 0.5 if rolls else None)))
    assert run.status == "ok", run.message
    gained = GRAVITY * (np.sin(slope) - np.cos(slope) * ARM / RADIUS) / 1.4 if rolls else 0.0
    assert run.responses["x"] == pytest.approx(0.5 * gained * 0.5**2, rel=0.02, abs=1e-9)
    assert run.responses["force"] == pytest.approx(MASS * GRAVITY * np.cos(slope), rel=1e-6)


def test_a_rolling_ball_slows_down_and_stops():
    """By 5/7 g ARM / R; so it comes v^2 / 2a far, and stays."""
    slowed = GRAVITY * ARM / RADIUS / 1.4
    run = simulate(made(rolled(ball(step=2e-3), 0.1)))
    assert run.status == "ok", run.message
    assert run.responses["x"] == pytest.approx(0.5 * 0.1**2 / slowed, rel=0.01)
    on_its_way = simulate(made(rolled(ball(duration=0.1), 0.1)))
    assert on_its_way.responses["x"] == pytest.approx(0.1 * 0.1 - 0.5 * slowed * 0.1**2, rel=1e-4)


def test_a_spinning_ball_stops_after_its_closed_form():
    """I w / ARM m g; until then it turns by w t - ARM m g t^2 / 2 I."""
    rate = ARM * MASS * GRAVITY / INERTIA
    data = ball(spinning_friction=ARM, rolling_friction=0.0)
    data["bodies"]["ball"]["angular_velocity"] = [0, 0, 0.2 * rate]
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["spin"] == pytest.approx(0.5 * rate * 0.2**2, rel=0.01)
    data["phases"] = [{"name": "run", "duration": 0.1}]
    assert simulate(made(data)).responses["spin"] == pytest.approx(rate * (0.02 - 0.005), rel=1e-3)


def test_what_it_takes_is_missing(tmp_path):
    """The kinetic energy falls by the moment times the angle, and no step creates or loses any."""
    run = simulate(made(rolled(ball(duration=0.1), 0.1)), trajectory=tmp_path / "run.h5")
    motion = read_trajectory(tmp_path / "run.h5")
    travel = motion.bodies["ball"].position[:, 0] - motion.bodies["ball"].position[0, 0]
    taken = ARM * MASS * GRAVITY * travel / RADIUS
    assert motion.kinetic + taken == pytest.approx(np.full(len(taken), motion.kinetic[0]), rel=1e-3)
    assert run.certificate.created_energy < 1e-9
    assert run.certificate.lost_energy < 1e-9


def test_a_wheel_that_lands_brakes_with_the_force_of_the_same_step():
    """A rolling ball falls on the floor: the impact brakes its rotation by ARM times its impulse."""
    data = rolled(ball(duration=0.02, friction=0.0), 0.5)
    data["bodies"]["ball"]["velocity"][2] = -0.5
    data["responses"]["turn"] = {"type": "angular_velocity", "body": "ball", "axis": [0, 1, 0]}
    run = simulate(made(data))
    impulse = MASS * 0.5 + MASS * GRAVITY * 0.02
    assert run.responses["turn"] == pytest.approx(0.5 / RADIUS - ARM * impulse / INERTIA, rel=1e-6)


def test_nothing_depends_on_place_or_order():
    data = rolled(ball(0.1, 0.05, spinning_friction=ARM), 0.1)
    data["bodies"]["ball"]["angular_velocity"][2] = 3.0
    first = simulate(made(data)).responses
    there = simulate(made(turned(data, Rotation.from_rotvec([0.3, -1.0, 0.7]), np.array([3.0, -2.0, 1.0]))))
    assert there.responses["x"] == pytest.approx(first["x"], rel=1e-6)
    other = data | {"bodies": dict(reversed(data["bodies"].items()))}
    assert simulate(made(other)).responses["x"] == pytest.approx(first["x"], rel=1e-6)


def test_without_it_nothing_is_there():
    """An arm of 0 leaves the arrays of a file without the key."""
    data = ball(rolling_friction=0.0)
    assert not assemble(made(data)).model.contacts.arm.size
    assert assemble(made(ball())).contact_names == ("touch", "touch~rolling")


def test_materials_have_it_and_every_number_has_a_key():
    data = ball()
    data["materials"] = {"dry": {"friction": 0.3, "rolling_friction": 0.002, "spinning_friction": 0.003}}
    del data["contacts"]["touch"]["friction"]
    data["contacts"]["touch"]["material"] = "dry"
    mechanism = made(data)
    assert mechanism.rolling_friction(mechanism.contacts["touch"]) == (ARM, 0.003)
    keys = settable_keys(mechanism)
    assert {"materials.dry.spinning_friction", "contacts.touch.rolling_friction"} <= set(keys)
    changed = set_values(mechanism, {"contacts.touch.rolling_friction": 0.005})
    assert changed.rolling_friction(changed.contacts["touch"]) == (0.005, 0.003)


@each(
    ("contact", "simulation", "named"),
    [
        ({"rolling_friction": -0.1}, {}, r"contacts\.touch\.rolling_friction"),
        ({"spinning_friction": -0.1}, {}, r"contacts\.touch\.spinning_friction"),
        ({}, {"scheme": "moreau_jean"}, r"contacts\.touch\.rolling_friction"),
    ],
)
def test_what_cannot_be_is_refused(contact, simulation, named):
    data = ball(**contact)
    data["simulation"] |= simulation
    with pytest.raises(MechanismError, match=named):
        made(data)
