"""Friction that differs along and across a grain: closed forms, the energy account, and what it leaves alone."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from engine import read_trajectory, simulate
from engine.assembly import assemble
from engine.errors import MechanismError
from engine.mechanism import set_values, settable_keys
from engine.trajectory import contact_forces
from tests.each import each
from tests.engine.small import GRAVITY, block_on_floor, made, turned

ALONG, ACROSS, MASS = 0.2, 0.5, 2.0


def brick(
    grain: float = 0.0,
    slope: float = 0.0,
    velocity: Any = (0.0, 0.0),
    duration: float | None = None,
    on: str = "b",
    step: float = 1e-3,
) -> dict[str, Any]:
    """Describe a brick on a floor that falls towards x, with a grain at an angle to x on one of the two."""
    data = block_on_floor(origin=[0, 0, 0.1], velocity=[*velocity, 0.0], friction=ALONG)
    data["gravity"] = [GRAVITY * np.sin(slope), 0, -GRAVITY * np.cos(slope)]
    data["simulation"]["step"] = step
    for name, contact in data["contacts"].items():
        contact[on]["grain"] = [np.cos(grain), np.sin(grain), 0.0]
        contact["friction_across"] = ACROSS
        data["responses"][f"rubbed_{name}"] = {"type": "friction_work", "contact": name}
        data["responses"][f"friction_{name}"] = {"type": "contact_force", "contact": name, "component": "friction"}
    if duration:
        data["phases"] = [{"name": "run", "duration": duration}]
    return data


def total(responses: dict[str, float], kind: str) -> float:
    """Add up a response of all contacts."""
    return sum(value for name, value in responses.items() if name.startswith(kind))


def holding(grain: float) -> float:
    """Return the friction that holds a brick on a slope: where its line of fall leaves the ellipse."""
    return 1 / float(np.hypot(np.cos(grain) / ALONG, np.sin(grain) / ACROSS))


def slide(grain: float, slope: float, speed: Any, end: float) -> Any:
    """Integrate m v' = m g_T - N (mu_1^2 v_1, mu_2^2 v_2) / |(mu_1 v_1, mu_2 v_2)|, from (x, y) = 0."""
    turn = np.array([[np.cos(grain), np.sin(grain)], [-np.sin(grain), np.cos(grain)]])
    mu = np.array([ALONG, ACROSS])

    def rate(_: float, w: Any) -> Any:
        v = turn @ w[2:]
        resists = turn.T @ (mu**2 * v) / np.linalg.norm(mu * v)
        return [*w[2:], *(GRAVITY * np.sin(slope) * np.array([1.0, 0.0]) - GRAVITY * np.cos(slope) * resists)]

    return solve_ivp(rate, (0, end), [0, 0, *speed], rtol=1e-10, atol=1e-13).y[:, -1]


@each("grain", [0.0, 0.5, 1.1, np.pi / 2, 2.5])
@each(("share", "slides"), [(0.99, False), (1.01, True)])
def test_a_slope_holds_up_to_the_ellipse(grain, share, slides):
    """Where mu_1 and mu_2 bound the parts of the weight, and neither of them alone."""
    slope = float(np.arctan(share * holding(grain)))
    run = simulate(made(brick(grain, slope, duration=0.3 if slides else None)))
    assert run.status == "ok", run.message
    moved = float(np.hypot(run.responses["x"], run.responses["y"]))
    assert moved > 5e-4 if slides else moved < 1e-9
    if not slides:
        weight = MASS * GRAVITY * np.sin(slope)
        assert total(run.responses, "friction_") == pytest.approx(weight, rel=1e-2)


@each("grain", [0.4, 1.0, 2.2])
def test_it_slides_off_the_line_of_fall(grain):
    """From rest along the straight line on which friction leaves an acceleration in the direction of the velocity."""
    slope = 0.6
    turn = np.array([[np.cos(grain), np.sin(grain)], [-np.sin(grain), np.cos(grain)]])
    fall, mu = turn @ [GRAVITY * np.sin(slope), 0.0], np.array([ALONG, ACROSS])

    def left(angle: float) -> Any:
        way = np.array([np.cos(angle), np.sin(angle)])
        return fall - GRAVITY * np.cos(slope) * mu**2 * way / np.linalg.norm(mu * way)

    def aside(angle: float) -> float:
        return float(np.cos(angle) * left(angle)[1] - np.sin(angle) * left(angle)[0])

    falls = float(np.arctan2(fall[1], fall[0]))
    angle = brentq(aside, falls - 1.0, falls + 1.0)
    expected = turn.T @ (0.5 * left(angle) * 0.2**2)
    run = simulate(made(brick(grain, slope, duration=0.2)))
    assert run.status == "ok", run.message
    assert abs(expected[1]) > 0.02 * expected[0]
    assert [run.responses["x"], run.responses["y"]] == pytest.approx(expected, rel=2e-3)


@each("on", ["a", "b"])
@each(("grain", "slope"), [(0.0, 0.0), (0.7, 0.0), (-0.4, 0.2)])
def test_a_thrown_brick_runs_on_the_curve_of_its_equation(grain, slope, on):
    """To first order: a step takes the direction of its end. A grain on the brick turns as little as it."""
    expected = slide(grain, slope, (1.0, 0.6), 0.15)
    run = simulate(made(brick(grain, slope, (1.0, 0.6), 0.15, on)))
    assert run.status == "ok", run.message
    assert [run.responses["x"], run.responses["y"]] == pytest.approx(expected[:2], rel=2e-3)


def test_the_error_halves_with_the_step():
    expected = slide(0.7, 0.0, (1.0, 0.6), 0.16)[:2]
    errors = []
    for step in (1.6e-2, 8e-3, 4e-3):
        found = simulate(made(brick(0.7, 0.0, (1.0, 0.6), 0.16, step=step))).responses
        errors.append(float(np.hypot(found["x"] - expected[0], found["y"] - expected[1])))
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.2)


def test_friction_takes_all_of_the_kinetic_energy():
    """Of a brick that comes to rest, and nothing else takes or makes any."""
    run = simulate(made(brick(0.7, 0.0, (1.0, 0.6))))
    assert run.status == "ok", run.message
    assert total(run.responses, "rubbed_") == pytest.approx(0.5 * MASS * (1.0 + 0.36), rel=1e-4)
    assert run.certificate.created_energy < 1e-8
    assert run.certificate.lost_energy < 1e-6


def test_the_speeds_along_and_across_follow_a_power_law(tmp_path):
    """On a level floor v_1 / v_1(0) = (v_2 / v_2(0))^(mu_1^2 / mu_2^2)."""
    simulate(made(brick(0.0, 0.0, (1.0, 0.8), 0.15)), trajectory=tmp_path / "run.h5")
    speed = read_trajectory(tmp_path / "run.h5").bodies["block"].velocity
    assert speed[-1, 0] / 1.0 == pytest.approx((speed[-1, 1] / 0.8) ** (ALONG**2 / ACROSS**2), rel=2e-3)


def test_recorded_impulses_and_forces_in_the_world_are_those_of_the_law(tmp_path):
    """T1 is along the grain; a response has the size of the same force; the sum of forces in the world brakes."""
    grain = 0.7
    run = simulate(made(brick(grain, 0.0, (1.0, 0.6), 0.1)), trajectory=tmp_path / "run.h5")
    trajectory = read_trajectory(tmp_path / "run.h5")
    speed = trajectory.bodies["block"].velocity
    at = len(speed) - 1
    part = np.array([[np.cos(grain), np.sin(grain)], [-np.sin(grain), np.cos(grain)]]) @ speed[at, :2]
    mu = np.array([ALONG, ACROSS])
    expected = -(mu**2) * part / np.linalg.norm(mu * part)
    for name in trajectory.contacts:
        normal, *friction = trajectory.contacts[name].impulse[at]
        if normal > 0:
            assert np.array(friction) / normal == pytest.approx(expected, rel=1e-5)
    forces = contact_forces(trajectory, [at])[1][0].sum(axis=0)
    assert forces[:2] == pytest.approx(MASS * (speed[at, :2] - speed[at - 1, :2]) / trajectory.step[at], rel=1e-6)
    pressed = MASS * GRAVITY * float(np.linalg.norm(expected))
    assert total(run.responses, "friction_") == pytest.approx(pressed, rel=1e-5)


def test_static_friction_and_the_table_over_the_speed_are_ellipses_of_the_same_shape():
    """At rest both hold 1.5 times as much; a table of 1 changes nothing."""
    grain = 1.0
    for factor, moves in ((1.49, False), (1.51, True)):
        for key, value in (("static_friction", 1.5 * ALONG), ("friction_over_speed", {"table": [[0, 1.5], [0.01, 1]]})):
            data = brick(grain, float(np.arctan(factor * holding(grain))), duration=0.3)
            for contact in data["contacts"].values():
                contact[key] = value
            run = simulate(made(data))
            assert (run.responses["x"] > 1e-3) == moves, (factor, key)
    data = brick(grain, 0.0, (1.0, 0.6), 0.1)
    first = simulate(made(data)).responses
    for contact in data["contacts"].values():
        contact["friction_over_speed"] = {"table": [[0, 1], [1, 1]]}
    second = simulate(made(data)).responses
    assert [second["x"], second["y"]] == pytest.approx([first["x"], first["y"]], rel=1e-9)


def test_the_table_is_read_at_the_speed_of_the_surface():
    """Between 0.5 and 1 m/s the factor falls from 1 to 0.5: along and across, at 0.75 m/s it is 0.75."""
    for grain, mu in ((0.0, ALONG), (np.pi / 2, ACROSS)):
        data = brick(grain, 0.0, (0.75, 0.0), 2e-3)
        for contact in data["contacts"].values():
            contact["friction_over_speed"] = {"table": [[0.5, 1.0], [1.0, 0.5]]}
        run = simulate(made(data)).responses
        assert run["x"] == pytest.approx(0.75 * 2e-3 - 0.5 * 0.75 * mu * GRAVITY * 4e-6, abs=1.5e-7)


def test_nothing_depends_on_place_or_order():
    """The same elsewhere, with contacts and bodies in another order, and with the sides named the other way round."""
    data = brick(0.7, 0.1, (1.0, 0.6), 0.1)
    first = simulate(made(data)).responses
    there = turned(data, Rotation.from_rotvec([0.3, -1.0, 0.7]), np.array([3.0, -2.0, 1.0]))
    moved = simulate(made(there)).responses
    other = data | {key: dict(reversed(data[key].items())) for key in ("bodies", "contacts")}
    for name in data["contacts"]:
        side = other["contacts"][name]
        side["a"], side["b"] = side["b"], side["a"]
    again = simulate(made(other)).responses
    for key in ("x", "y", "rubbed_", "friction_"):  # each corner's share is not determined, their sum is
        expected = pytest.approx(total(first, key), rel=1e-6)
        assert total(moved, key) == expected, key
        assert total(again, key) == expected, key


def test_the_grain_turned_by_a_right_angle_swaps_the_coefficients():
    data, other = brick(0.3, 0.4, duration=0.1), brick(0.3 + np.pi / 2, 0.4, duration=0.1)
    for contact in other["contacts"].values():
        contact["friction"], contact["friction_across"] = ACROSS, ALONG
    first, second = simulate(made(data)).responses, simulate(made(other)).responses
    assert [second["x"], second["y"]] == pytest.approx([first["x"], first["y"]], rel=1e-9)
    rests, too = (
        simulate(made(each | {"gravity": [0.5, 0.0, -GRAVITY], "phases": [{"name": "run"}]})).responses
        for each in (data, other)
    )
    assert too == pytest.approx(rests, rel=1e-5, abs=1e-6)


def test_equal_coefficients_are_one():
    """They have the bits of a file without a grain, and no array of their own."""
    data = brick(0.7, 0.0, (1.0, 0.6), 0.1)
    for contact in data["contacts"].values():
        contact["friction_across"] = ALONG
    first = simulate(made(data))
    for contact in data["contacts"].values():
        del contact["friction_across"], contact["b"]["grain"]
    assert simulate(made(data)).responses == first.responses
    assert not assemble(made(data)).model.contacts.grain.size


def test_a_ball_rolls_and_spins_as_without_a_grain():
    """What resists rolling and spinning has no direction in the surface: a ball that rolls askew slows down equally."""
    data = brick()
    data["bodies"]["block"] = {
        "mass": 0.5,
        "inertia": [8e-5] * 3,
        "origin": [0, 0, 0.02],
        "velocity": [0.08, 0.06, 0],
        "angular_velocity": [-3.0, 4.0, 2.0],
    }
    data["contacts"] = {
        "touch": {
            "a": {"body": "block", "sphere": {"centre": [0, 0, 0], "radius": 0.02}},
            "b": {**data["contacts"]["corner_0"]["b"], "grain": [1.0, 0.5, 0.0]},
            "friction": 0.4,
            "friction_across": 0.8,
            "rolling_friction": 1e-3,
            "spinning_friction": 1e-3,
        }
    }
    data["responses"] = {key: data["responses"][key] for key in "xyz"}
    data["phases"] = [{"name": "run", "duration": 0.1}]
    grained = simulate(made(data)).responses
    del data["contacts"]["touch"]["b"]["grain"], data["contacts"]["touch"]["friction_across"]
    plain = simulate(made(data)).responses
    assert grained == pytest.approx(plain, rel=1e-6, abs=1e-9)


def test_a_grain_along_a_cylinder_acts_all_around_it():
    """A heavy ball slides along the axis: with the grain along it, or around it."""
    for grain, mu in (([1.0, 0.0, 0.0], ALONG), ([0.0, 1.0, 0.0], ACROSS)):
        data = brick(0.0, 0.0, (0.5, 0.0), 0.05)
        ball = {"centre": [0, 0, 0], "radius": 0.02}
        data["bodies"]["block"] |= {"origin": [0, 0, 0.05]}
        base = {"point": [0, 0, -0.05], "axis": [1, 0, 0], "radius": 0.1 - 0.02}
        data["contacts"] = {
            "touch": {
                "a": {"body": "block", "sphere": ball},
                "b": {"body": "ground", "cylinder": base, "grain": grain},
                "friction": ALONG,
                "friction_across": ACROSS,
            }
        }
        data["joints"] = {
            "upright": {
                "type": "planar",
                "a": {"body": "ground", "point": [0, 0, 0], "normal": [0, 1, 0]},
                "b": {"body": "block", "point": [0, 0, 0], "normal": [0, 1, 0]},
            }
        }
        data["responses"] = {"x": data["responses"]["x"], "work": {"type": "friction_work", "contact": "touch"}}
        run = simulate(made(data))
        assert run.status == "ok", run.message
        assert run.responses["x"] == pytest.approx(0.5 * 0.05 - 0.5 * mu * GRAVITY * 0.05**2, rel=2e-3)


def test_materials_have_it_and_every_number_has_a_key():
    """That of the materials for a contact with a grain, unless the contact has a friction of its own."""
    data = brick(0.0)
    data["materials"] = {"planed": {"friction": 0.3, "friction_across": 0.6}}
    for i, contact in enumerate(data["contacts"].values()):
        contact["material"] = "planed"
        if i:
            del contact["friction"], contact["friction_across"]
    mechanism = made(data)
    assert mechanism.friction_across(mechanism.contacts["corner_0"]) == ACROSS
    assert mechanism.friction_across(mechanism.contacts["corner_1"]) == 0.6
    keys = {"materials.planed.friction_across", "contacts.corner_0.friction_across", "contacts.corner_0.b.grain.y"}
    assert keys <= set(settable_keys(mechanism))
    changed = set_values(mechanism, {"contacts.corner_0.friction_across": 0.7, "materials.planed.friction_across": 0.8})
    assert changed.friction_across(changed.contacts["corner_0"]) == 0.7
    assert changed.friction_across(changed.contacts["corner_1"]) == 0.8
    with pytest.raises(MechanismError, match=r"contacts\.corner_0\.friction_across"):
        assemble(set_values(mechanism, {"contacts.corner_0.friction": 0.0}))


@each(
    ("contact", "grain", "materials", "named"),
    [
        ({"friction_across": 0.0}, {"b": [1, 0, 0]}, {}, r"contacts\.corner_0\.friction_across"),
        ({"friction_across": 0.5}, {}, {}, r"contacts\.corner_0\.friction_across"),
        ({"friction_across": 21.0}, {"b": [1, 0, 0]}, {}, r"contacts\.corner_0\.friction_across"),
        ({}, {"b": [1, 0, 0]}, {}, r"contacts\.corner_0\.friction_across"),
        ({"friction_across": 0.5}, {"a": [1, 0, 0], "b": [1, 0, 0]}, {}, r"contacts\.corner_0\.b\.grain"),
        ({"friction_across": 0.5}, {"b": [1, 0, 0.1]}, {}, r"contacts\.corner_0\.b\.grain"),
        ({"friction_across": 0.5}, {"b": [0, 0, 0]}, {}, r"contacts\.corner_0\.b\.grain"),
        (
            {"friction": None, "material": "planed"},
            {},
            {"planed": {"friction": 0.2, "friction_across": 0.5}},
            r"contacts\.corner_0\.a\.grain",
        ),
        ({}, {}, {"planed": {"friction": 0.2, "friction_across": 0.0}}, r"materials\.planed\.friction_across"),
    ],
)
def test_what_cannot_be_is_refused(contact, grain, materials, named):
    data = block_on_floor(friction=ALONG)
    data["materials"] = materials
    entry = data["contacts"]["corner_0"] | contact
    data["contacts"]["corner_0"] = {key: value for key, value in entry.items() if value is not None}
    for side, direction in grain.items():
        data["contacts"]["corner_0"][side]["grain"] = direction
    with pytest.raises(MechanismError, match=named):
        made(data)


def test_a_ball_in_a_socket_and_a_joint_have_no_grain():
    data = block_on_floor(friction=ALONG)
    data["contacts"]["corner_0"] = {
        "a": {"body": "block", "sphere": {"centre": [0, 0, 0], "radius": 0.01}, "grain": [1, 0, 0]},
        "b": {"body": "ground", "socket": {"centre": [0, 0, 0], "radius": 0.02}},
        "friction": 0.2,
        "friction_across": 0.3,
    }
    with pytest.raises(MechanismError, match=r"contacts\.corner_0\.a\.grain"):
        made(data)
    data = block_on_floor(friction=ALONG)
    data["materials"] = {"planed": {"friction": 0.2, "friction_across": 0.5}}
    data["joints"] = {
        "ball": {
            "type": "clearance_spherical",
            "socket": {"body": "ground", "point": [0, 0, 0]},
            "ball": {"body": "block", "point": [0, 0, 0], "radius": 0.02},
            "radial_clearance": 0.001,
            "material": "planed",
        }
    }
    with pytest.raises(MechanismError, match=r"joints\.ball\.friction"):
        made(data)
