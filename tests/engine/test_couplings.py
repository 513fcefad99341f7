"""Couplings of joint coordinates: gears, racks, screws, belts, backlash and planetary sets, against closed forms."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.assembly import Assembly, assemble
from engine.errors import MechanismError
from engine.friction.arrays import dense_rows
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.contacts import whitened_rows
from engine.kernels.motion import move
from engine.mechanism import set_values
from engine.preflight.cautions import cautions
from tests.engine.small import GRAVITY, coordinates, made, small, turned

SMALL, LARGE = 0.1, 0.4  # inertias


def revolute(body: str, at: Any = (0, 0, 0), base: str = "ground", point: Any = (0, 0, 0)) -> dict[str, Any]:
    """Describe a hinge about z."""
    return {
        "type": "revolute",
        "bearing": {"body": base, "point": list(at), "axis": [0, 0, 1]},
        "journal": {"body": body, "point": list(point), "axis": [0, 0, 1]},
    }


def sliding(body: str, axis: Any, kind: str = "prismatic") -> dict[str, Any]:
    """Describe a guide through the body's origin."""
    first, second = ("guide", "slider") if kind == "prismatic" else ("bearing", "journal")
    return {
        "type": kind,
        first: {"body": "ground", "point": [0, 0, 0], "axis": axis},
        second: {"body": body, "point": [0, 0, 0], "axis": axis},
    }


def spins(*bodies: str) -> dict[str, Any]:
    """Measure the angular velocity of bodies about z."""
    return {body: {"type": "angular_velocity", "body": body, "axis": [0, 0, 1]} for body in bodies}


def angles(*bodies: str) -> dict[str, Any]:
    """Measure the angle of bodies about z."""
    return {f"{body}_angle": {"type": "angle", "body": body, "axis": [0, 0, 1]} for body in bodies}


def wheels(duration: float = 1.0, torque: float = 0.3, **coupling: Any) -> dict[str, Any]:
    """Describe a pinion that is driven, and a wheel, on shafts of their own."""
    terms = [{"joint": "first", "factor": 20}, {"joint": "second", "factor": 40}]
    return small(
        phases=[{"name": "run", "duration": duration}],
        bodies={
            "ground": {"fixed": True},
            "pinion": {"mass": 1.0, "inertia": [1, 1, SMALL]},
            "wheel": {"mass": 2.0, "inertia": [1, 1, LARGE], "origin": [1, 0, 0]},
        },
        joints={"first": revolute("pinion"), "second": revolute("wheel", [1, 0, 0])},
        couplings={"mesh": {"terms": terms, **coupling}},
        torques={"motor": {"body": "pinion", "torque": [0, 0, torque]}},
        responses=spins("pinion", "wheel")
        | angles("pinion", "wheel")
        | {face: {"type": "contact_force", "contact": f"mesh.{face}"} for face in ("forward", "backward")},
    )


def test_two_wheels_accelerate_as_one():
    """Inertia I1 + I2 / 4 at the pinion; the flank that pushes carries what the wheel needs, seen from there."""
    run = simulate(made(wheels()))
    assert run.status == "ok", run.message
    rate = 0.3 / (SMALL + LARGE / 4)
    assert run.responses["pinion"] == pytest.approx(rate, rel=1e-8)
    assert run.responses["wheel"] == pytest.approx(-rate / 2, rel=1e-8)
    assert run.responses["pinion_angle"] == pytest.approx(rate / 2, rel=1e-6)
    assert run.responses["wheel_angle"] == pytest.approx(-rate / 4, rel=1e-6)
    assert run.responses["backward"] - run.responses["forward"] == pytest.approx(0.3 - SMALL * rate, rel=1e-7)
    assert run.certificate.created_energy < 1e-9
    assert run.certificate.lost_energy < 1e-9
    assert run.certificate.max_penetration < 1e-8


def test_friction_of_both_shafts_counts_through_the_ratio():
    """0.05 N m at the pinion, 0.1 N m at the wheel: half of that at the pinion; together they hold 0.1 N m there."""
    data = wheels()
    data["joints"]["first"]["friction_torque"] = 0.05
    data["joints"]["second"]["friction_torque"] = 0.1
    data["responses"]["taken"] = {"type": "friction_work", "contact": "second.friction_torque"}
    run = simulate(made(data))
    assert run.responses["pinion"] == pytest.approx((0.3 - 0.1) / (SMALL + LARGE / 4), rel=1e-7)
    assert run.responses["taken"] == pytest.approx(-0.1 * run.responses["wheel_angle"], rel=1e-6)
    for torque, speed in ((0.099, 0.0), (0.11, 0.01 / (SMALL + LARGE / 4))):
        held = simulate(set_values(made(data), {"torques.motor.torque.z": torque}))
        assert held.responses["pinion"] == pytest.approx(speed, rel=1e-6, abs=1e-9)


def test_the_ratio_holds_over_many_turns():
    """Ten turns and more of the pinion; also turned elsewhere, and with a belt, whose wheels turn alike."""
    data = wheels(5.0, 2.4)
    data["simulation"]["horizon"] = 5.0
    run = simulate(made(data))
    assert run.responses["pinion_angle"] > 20 * np.pi
    assert run.responses["wheel_angle"] == pytest.approx(-run.responses["pinion_angle"] / 2, abs=1e-7)
    there = simulate(made(turned(data, Rotation.from_rotvec([0.3, -1.0, 0.7]), np.array([3.0, -2.0, 1.0]))))
    assert there.responses["wheel_angle"] == pytest.approx(run.responses["wheel_angle"], rel=1e-7)
    belt = simulate(set_values(made(data), {"couplings.mesh.terms.1.factor": -40.0}))
    assert belt.responses["wheel_angle"] == pytest.approx(-run.responses["wheel_angle"], rel=1e-7)


def test_backlash_is_free_and_then_strikes():
    """The pinion turns freely by half of it, strikes, and both go on with their common momentum about it."""
    data = wheels(0.6, 0.0, backlash=0.4)
    data["bodies"]["pinion"]["angular_velocity"] = [0, 0, 1.0]
    data["responses"] |= {"before": {**spins("pinion")["pinion"], "at": {"response": "pinion_angle", "above": 0.19}}}
    run = simulate(made(data))
    common = SMALL / (SMALL + LARGE / 4)
    assert run.responses["before"] == pytest.approx(1.0, rel=1e-12)
    assert run.responses["pinion"] == pytest.approx(common, rel=1e-8)
    assert run.responses["wheel"] == pytest.approx(-common / 2, rel=1e-8)
    assert run.responses["pinion_angle"] == pytest.approx(0.2 + common * 0.4, abs=1e-3)
    data["couplings"]["mesh"]["restitution"] = 0.5
    back = simulate(made(data)).responses
    assert back["pinion"] + back["wheel"] * 2 == pytest.approx(-0.5, rel=1e-6)


def test_a_rack_on_its_pinion():
    """A rack of 3 kg falls and turns a pinion of radius 0.2 m: g m / (m + I / r^2); at rest the flank holds it."""
    data = small(
        gravity=[0, -GRAVITY, 0],
        phases=[{"name": "run", "duration": 0.5}],
        bodies={
            "ground": {"fixed": True},
            "rack": {"mass": 3.0, "inertia": [1, 1, 1]},
            "pinion": {"mass": 1.0, "inertia": [1, 1, SMALL], "origin": [0.2, 0, 0]},
        },
        joints={"way": sliding("rack", [0, 1, 0]), "shaft": revolute("pinion", [0.2, 0, 0])},
        couplings={"mesh": {"terms": [{"joint": "way", "factor": 1.0}, {"joint": "shaft", "factor": 0.2}]}},
        responses=coordinates("rack") | spins("pinion"),
    )
    rate = GRAVITY * 3.0 / (3.0 + SMALL / 0.2**2)
    run = simulate(made(data))
    assert run.responses["y"] == pytest.approx(-0.5 * rate * 0.5**2, rel=1e-6)
    assert run.responses["pinion"] == pytest.approx(rate * 0.5 / 0.2, rel=1e-7)
    data["joints"]["shaft"]["friction_torque"] = 10.0
    data["phases"] = [{"name": "settle"}]
    data["responses"] = coordinates("rack") | {
        "held": {"type": "contact_force", "contact": "shaft.friction_torque"},
        **{face: {"type": "contact_force", "contact": f"mesh.{face}"} for face in ("forward", "backward")},
    }
    held = simulate(made(data))
    assert held.status == "ok", held.message
    assert held.responses["forward"] == pytest.approx(3.0 * GRAVITY, rel=1e-5)
    assert held.responses["held"] == pytest.approx(3.0 * GRAVITY * 0.2, rel=1e-5)


def test_a_screw_is_a_joint_coupled_with_itself():
    """A nut that falls on a thread of 0.3 m a turn: g / (1 + I / (m p^2)), p = 0.3 / 2 pi."""
    lead = 0.3 / (2 * np.pi)
    data = small(
        gravity=[0, 0, -GRAVITY],
        phases=[{"name": "run", "duration": 0.5}],
        bodies={"ground": {"fixed": True}, "nut": {"mass": 2.0, "inertia": [1, 1, 0.02]}},
        joints={"thread": sliding("nut", [0, 0, 1], "cylindrical")},
        couplings={
            "lead": {
                "terms": [
                    {"joint": "thread", "of": "travel", "factor": 1.0},
                    {"joint": "thread", "of": "angle", "factor": -lead},
                ]
            }
        },
        responses=coordinates("nut") | spins("nut") | angles("nut"),
    )
    rate = GRAVITY / (1 + 0.02 / (2.0 * lead**2))
    run = simulate(made(data))
    assert run.responses["z"] == pytest.approx(-0.5 * rate * 0.5**2, rel=1e-6)
    assert run.responses["nut"] == pytest.approx(-rate * 0.5 / lead, rel=1e-7)
    assert run.responses["z"] == pytest.approx(lead * run.responses["nut_angle"], rel=1e-9)


TEETH = 20.0, 16.0, 52.0  # of the sun, the planets and the ring
ARM, MASS = 0.36, 0.5  # of a planet


def planetary() -> dict[str, Any]:
    """Describe a sun that is driven, two planets on a carrier, and a ring that stands."""
    sun, planet, ring = TEETH
    return small(
        phases=[{"name": "run", "duration": 1.0}],
        bodies={
            "ground": {"fixed": True},
            "sun": {"mass": 1.0, "inertia": [1, 1, 0.05]},
            "carrier": {"mass": 1.0, "inertia": [1, 1, 0.2]},
            "planet_a": {"mass": MASS, "inertia": [1, 1, 0.01], "origin": [ARM, 0, 0]},
            "planet_b": {"mass": MASS, "inertia": [1, 1, 0.01], "origin": [-ARM, 0, 0]},
        },
        joints={
            "sun": revolute("sun"),
            "carrier": revolute("carrier"),
            "pin_a": revolute("planet_a", [ARM, 0, 0], "carrier"),
            "pin_b": revolute("planet_b", [-ARM, 0, 0], "carrier"),
        },
        # seen from the carrier: sun against planet, and planet in a ring that stands, which is -carrier
        couplings={
            f"{what}_{p}": {"terms": terms}
            for p in "ab"
            for what, terms in {
                "sun": [
                    {"joint": "sun", "factor": sun},
                    {"joint": "carrier", "factor": -sun},
                    {"joint": f"pin_{p}", "factor": planet},
                ],
                "ring": [{"joint": f"pin_{p}", "factor": planet}, {"joint": "carrier", "factor": ring}],
            }.items()
        },
        torques={"motor": {"body": "sun", "torque": [0, 0, 0.2]}},
        responses=spins("sun", "carrier") | angles("sun", "carrier"),
    )


def test_a_planetary_set_keeps_to_willis():
    """With the ring held, carrier / sun = 20 / 72; its inertia counts all four bodies, each at its own speed."""
    (sun, planet, ring), data = TEETH, planetary()
    run = simulate(made(data))
    assert run.status == "ok", run.message
    ratio = sun / (sun + ring)
    spin = ratio - ratio * ring / planet  # of a planet in the world, per speed of the sun
    inertia = 0.05 + (0.2 + 2 * MASS * ARM**2) * ratio**2 + 2 * 0.01 * spin**2
    assert run.responses["carrier"] / run.responses["sun"] == pytest.approx(ratio, rel=1e-7)
    assert run.responses["sun"] == pytest.approx(0.2 / inertia, rel=1e-6)
    assert run.responses["carrier_angle"] == pytest.approx(ratio * run.responses["sun_angle"], rel=1e-7)
    assert run.certificate.created_energy < 1e-8


def row_velocities(assembly: Assembly) -> Any:
    """Return what the rows of all contacts at the sites last found give for the twists of the state, (nc, 3)."""
    bodies, state, rows = assembly.model.bodies, assembly.state, assembly.problem.rows
    whitened = np.zeros(assembly.problem.w.size)
    for body, node in enumerate(bodies.node):
        root = np.linalg.cholesky(bodies.inertia[body])
        whitened[8 * node : 8 * node + 3] = np.sqrt(bodies.mass[body]) * state.v[body, :3]
        whitened[8 * node + 3 : 8 * node + 6] = root.T @ state.v[body, 3:]
    for i in range(len(state.gap)):
        whitened_rows(bodies, assembly.model.contacts, state.x, state.R, assembly.work.sites, i, rows, i)
    return dense_rows(rows.node[: len(state.gap)], rows.G[: len(state.gap)], whitened.size) @ whitened


@given(st.integers(0, 10**6))
def test_rows_and_velocities_are_the_rates_of_the_gap(seed):
    """At any angles about the axes and for any spins, by central differences."""
    rng, assembly = np.random.default_rng(seed), assemble(made(planetary()))
    contacts, state, work = assembly.model.contacts, assembly.state, assembly.work
    state.v[:-1, 5] = rng.normal(size=4)
    move(state, 0.5)
    state.v[:-1, 5] = rng.normal(size=4)
    gaps, d, gap = [], 1e-6, np.zeros(8)
    for dt in (d, -2 * d):
        move(state, dt)
        find_contacts(contacts, state.x, state.R, gap, work.sites.point, work.sites.frame)
        gaps.append(gap.copy())
    move(state, d)
    rates = (gaps[0] - gaps[1]) / (2 * d)
    found = row_velocities(assembly)
    assert found[:, 0] == pytest.approx(rates, rel=1e-5, abs=1e-6)
    assert not found[:, 1:].any()


def test_a_coupled_wheel_is_not_warned_of():
    """It has no load of its own, but its pinion has; without friction the two never rest."""
    data = wheels()
    data["phases"] = [{"name": "settle"}]
    (warning,) = cautions(made(data))
    assert "it never comes to rest" in str(warning)
    data["joints"]["second"]["friction_torque"] = 1.0
    assert cautions(made(data)) == []


def fault(data: dict[str, Any]) -> str:
    """Return the message of the one fault of a mechanism."""
    with pytest.raises(MechanismError) as caught:
        assemble(made(data))
    return str(caught.value).split("\n")[1].strip()


def test_couplings_that_make_no_sense_are_refused_with_what_is_allowed():
    """Each message begins with the key."""
    assert fault(wheels(terms=[{"joint": "first", "factor": 1}])).startswith("couplings.mesh.terms")
    twice = wheels(terms=[{"joint": "first", "factor": 1}, {"joint": "first", "factor": 2}])
    assert "every coordinate once" in fault(twice)
    assert "a factor of 0 couples nothing" in fault(
        wheels(terms=[{"joint": "first", "factor": 1}, {"joint": "second", "factor": 0}])
    )
    missing = wheels(terms=[{"joint": "first", "factor": 1}, {"joint": "third", "factor": 2}])
    assert fault(missing).startswith("couplings.mesh.terms.1.joint")
    slides = wheels(terms=[{"joint": "first", "factor": 1}, {"joint": "second", "of": "travel", "factor": 2}])
    assert "second has only its angle" in fault(slides)
    screw = wheels(terms=[{"joint": "first", "factor": 1}, {"joint": "second", "factor": 2}])
    screw["joints"]["second"]["type"] = "cylindrical"
    assert "second turns and slides" in fault(screw)
    named = wheels()
    named["couplings"]["first"] = named["couplings"].pop("mesh")
    del named["responses"]["forward"], named["responses"]["backward"]
    assert "joints.first has the same name" in fault(named)


def test_one_parameter_is_radius_of_a_rack_and_place_of_its_pinion():
    """Its factor is a length, as is the place; what varies is one number."""
    terms = [{"joint": "slide", "factor": 1.0}, {"joint": "first", "factor": "-r"}]
    mechanism = made(
        small(
            parameters={"r": 0.01},
            bodies={
                "ground": {"fixed": True},
                "rack": {"mass": 1.0, "inertia": [1, 1, 1]},
                "pinion": {"mass": 1.0, "inertia": [1, 1, 1], "origin": [0, "r", 0]},
            },
            joints={"slide": sliding("rack", [1, 0, 0]), "first": revolute("pinion", at=[0, "r", 0])},
            couplings={"mesh": {"terms": terms}},
            responses={"x": coordinates("rack")["x"]},
        )
    )
    assert mechanism.parameter_units == {"r": "m"}
    assert set_values(mechanism, {"parameters.r": 0.02}).couplings["mesh"].terms[1].factor == -0.02
