"""Pairs of gears: gaps of involutes, and forces along the line of action, against closed forms."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.assembly import assemble
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.motion import move
from engine.mechanism import set_values
from engine.preflight.cautions import cautions
from tests.engine.small import made, small, turned
from tests.engine.test_couplings import LARGE, SMALL, angles, fault, revolute, row_velocities, spins

ANGLE = np.radians(20.0)


def pair(internal: bool = False, duration: float = 1.0, torque: float = 0.3, **mesh: Any) -> dict[str, Any]:
    """Describe a pinion of 20 teeth that is driven, and a gear or a ring of 40, with radii of 0.2 and 0.4 m."""
    at = [0.2, 0, 0] if internal else [0.6, 0, 0]
    gear = {"point": [0, 0, 0], "axis": [0, 0, 1]}
    wheel = {"body": "wheel", **gear, "teeth": 40, "internal": internal}
    mesh = {"module": 0.02, "backlash": 1e-8, **mesh}
    return small(
        phases=[{"name": "run", "duration": duration}],
        bodies={
            "ground": {"fixed": True},
            "pinion": {"mass": 1.0, "inertia": [1, 1, SMALL]},
            "wheel": {"mass": 2.0, "inertia": [1, 1, LARGE], "origin": at},
        },
        joints={"first": revolute("pinion"), "second": revolute("wheel", at)},
        couplings={"mesh": {"gears": [{"body": "pinion", **gear, "teeth": 20}, wheel], **mesh}},
        torques={"motor": {"body": "pinion", "torque": [0, 0, torque]}},
        responses=spins("pinion", "wheel")
        | angles("pinion", "wheel")
        | {face: {"type": "contact_force", "contact": f"mesh.{face}"} for face in ("forward", "backward")},
    )


@pytest.mark.parametrize("internal", [False, True])
def test_two_gears_accelerate_as_one(internal):
    """Inertia I1 + I2 / 4 at the pinion; the flank that pushes carries the wheel's torque over its base radius."""
    run = simulate(made(pair(internal)))
    assert run.status == "ok", run.message
    rate, sign = 0.3 / (SMALL + LARGE / 4), 1.0 if internal else -1.0
    assert run.responses["pinion"] == pytest.approx(rate, rel=1e-7)
    assert run.responses["wheel"] == pytest.approx(sign * rate / 2, rel=1e-7)
    assert run.responses["wheel_angle"] == pytest.approx(sign * rate / 4, rel=1e-6)
    force = LARGE * rate / 2 / (0.4 * np.cos(ANGLE))
    assert run.responses["backward"] == pytest.approx(force, rel=1e-6)
    assert run.responses["forward"] == 0.0
    assert run.certificate.created_energy < 1e-8
    assert run.certificate.lost_energy < 1e-8


def test_the_ratio_holds_over_many_turns_wherever_it_is():
    """Ten turns and more; turned elsewhere; a ring; and in another order of the two gears."""
    data = pair(duration=5.0, torque=2.4)
    data["simulation"]["horizon"] = 5.0
    run = simulate(made(data))
    assert run.responses["pinion_angle"] > 20 * np.pi
    assert run.responses["wheel_angle"] == pytest.approx(-run.responses["pinion_angle"] / 2, abs=1e-6)
    there = simulate(made(turned(data, Rotation.from_rotvec([0.3, -1.0, 0.7]), np.array([3.0, -2.0, 1.0]))))
    assert there.responses["wheel_angle"] == pytest.approx(run.responses["wheel_angle"], rel=1e-7)
    data["couplings"]["mesh"]["gears"].reverse()
    swapped = simulate(made(data))
    assert swapped.responses["wheel_angle"] == pytest.approx(run.responses["wheel_angle"], rel=1e-7)
    ring = pair(True, backlash=0.01)
    ring["couplings"]["mesh"]["gears"].reverse()
    found, turning = simulate(made(ring)).responses, simulate(made(pair(True, backlash=0.01))).responses
    assert found["wheel"] == pytest.approx(turning["wheel"], rel=1e-9)
    assert found["forward"] == pytest.approx(turning["backward"], rel=1e-9)


@pytest.mark.parametrize(("apart", "internal"), [(0.0, False), (0.004, False), (-0.003, True)])
def test_backlash_grows_with_the_centre_distance_as_that_of_involutes(apart, internal):
    """Turned by hand in both directions until the teeth touch: j cos p + 2 (a + b) (inv p' - inv p), over a."""
    data = pair(internal, backlash=0.002, torque=0.0)
    for place in (data["bodies"]["wheel"]["origin"], data["joints"]["second"]["bearing"]["point"]):
        place[0] += apart
    distance, nominal = data["bodies"]["wheel"]["origin"][0], 0.2 if internal else 0.6
    data["joints"]["second"]["friction_torque"] = 50.0
    data["motions"] = {
        "hand": {"body": "pinion", "about": {"axis": [0, 0, 1]}, "law": {"amplitude": 1e-2, "period": 1}}
    }
    data["responses"] = {
        "gap": {"type": "gap", "contact": "mesh.forward"},
        "other": {"type": "gap", "contact": "mesh.backward"},
    }
    del data["torques"]
    held = made(data)
    gaps = simulate(set_values(held, {"motions.hand.law.amplitude": 1e-9})).responses
    both = (-1 if internal else 1) * nominal * np.cos(ANGLE)
    now = np.arccos(nominal * np.cos(ANGLE) / distance)
    involutes = (np.tan(now) - now) - (np.tan(ANGLE) - ANGLE)
    expected = 0.002 * np.cos(ANGLE) + 2 * both * involutes
    assert gaps["gap"] + gaps["other"] == pytest.approx(expected, rel=1e-9)
    assert expected > 0.0019 * np.cos(ANGLE)


@pytest.mark.parametrize(
    ("growths", "teeth", "distance"),
    [
        ({"ground": 0.003, "pinion": 0.003, "wheel": 0.003}, 1.003, 1.003),
        ({"pinion": 0.001, "wheel": 0.001}, 1.001, 1.0),
        ({"wheel": 0.0015}, 1.001, 1.0),
    ],
)
@pytest.mark.parametrize("internal", [False, True])
def test_teeth_grow_with_their_bodies(growths, teeth, distance, internal):
    """All alike leave the backlash; else it is that of the larger base circles, of two materials by their radii."""
    data = pair(internal, backlash=0.002)
    if internal and len(growths) == 1:
        growths = {"wheel": 0.0005}  # 0.4 m of 0.2 m
    for body, growth in growths.items():
        data["bodies"][body]["growth"] = growth
    both = (-0.2 if internal else 0.6) * np.cos(ANGLE) * teeth
    now = np.arccos(np.cos(ANGLE) * teeth / distance)
    expected = 0.002 * np.cos(ANGLE) + 2 * both * ((np.tan(now) - now) - (np.tan(ANGLE) - ANGLE))
    gap = assemble(made(data)).state.gap
    assert gap.sum() == pytest.approx(expected, rel=1e-7)
    assert gap[0] == pytest.approx(gap[1], rel=1e-7)


def test_the_line_of_action_pushes_the_bearings_apart():
    """The wheel on a guide along the centre line: what holds it is the tangential force times tan of 20 degrees."""
    data = pair(duration=0.2)
    data["bodies"]["slide"] = {"mass": 1.0, "inertia": [1, 1, 1], "origin": [0.6, 0, 0]}
    data["joints"]["second"] = revolute("wheel", [0, 0, 0], "slide")
    data["joints"]["way"] = {
        "type": "prismatic",
        "guide": {"body": "ground", "point": [0.6, 0, 0], "axis": [1, 0, 0]},
        "slider": {"body": "slide", "point": [0, 0, 0], "axis": [1, 0, 0]},
        "limits": {"lower": -0.1, "upper": 0.0},
    }
    data["responses"]["held"] = {"type": "contact_force", "contact": "way.upper"}
    run = simulate(made(data))
    rate = 0.3 / (SMALL + LARGE / 4)
    assert run.responses["held"] == pytest.approx(LARGE * rate / 2 / 0.4 * np.tan(ANGLE), rel=1e-5)


def carried() -> dict[str, Any]:
    """Describe a sun that is driven, a planet on a carrier, and a ring that stands: 20, 16 and 52 teeth."""
    gear = {"point": [0, 0, 0], "axis": [0, 0, 1]}
    sun, ring = {"body": "sun", **gear, "teeth": 20}, {"body": "ground", **gear, "teeth": 52, "internal": True}
    planet = {"body": "planet", **gear, "teeth": 16}
    data = small(
        phases=[{"name": "begin", "duration": 0.5}, {"name": "run", "duration": 0.5}],
        bodies={
            "ground": {"fixed": True},
            "sun": {"mass": 1.0, "inertia": [1, 1, 0.05]},
            "carrier": {"mass": 1.0, "inertia": [1, 1, 0.2]},
            "planet": {"mass": 0.5, "inertia": [1, 1, 0.01], "origin": [0.36, 0, 0]},
        },
        joints={
            "sun": revolute("sun"),
            "carrier": revolute("carrier"),
            "pin": revolute("planet", [0.36, 0, 0], "carrier"),
        },
        couplings={
            "inner": {"gears": [sun, planet], "module": 0.02, "backlash": 1e-3},
            "outer": {"gears": [planet, ring], "module": 0.02, "backlash": 1e-3},
        },
        torques={"motor": {"body": "sun", "torque": [0, 0, 0.2]}},
        responses=spins("sun")
        | angles("sun", "carrier")
        | {
            f"{name}_before": {**response, "to_phase": "begin"}
            for name, response in (spins("sun") | angles("sun", "carrier")).items()
        },
    )
    return data


def test_a_planetary_set_keeps_to_willis():
    """Nothing but the gears says that the planet is on a carrier: carrier / sun = 20 / 72."""
    run = simulate(made(carried()))
    assert run.status == "ok", run.message
    ratio = 20 / 72
    spin = ratio - ratio * 52 / 16
    inertia = 0.05 + (0.2 + 0.5 * 0.36**2) * ratio**2 + 0.01 * spin**2
    gained = {
        name: run.responses[name] - run.responses[f"{name}_before"] for name in ("sun", "sun_angle", "carrier_angle")
    }
    assert gained["carrier_angle"] == pytest.approx(ratio * gained["sun_angle"], rel=1e-6)
    assert gained["sun"] == pytest.approx(0.5 * 0.2 / inertia, rel=1e-3)
    assert run.certificate.created_energy < 1e-6


@given(st.integers(0, 10**6))
def test_rows_are_the_gradient_of_the_gap(seed):
    """For any motion of the bodies in their plane, by central differences."""
    rng, data = np.random.default_rng(seed), carried()
    assembly = assemble(made(data))
    contacts, state, work = assembly.model.contacts, assembly.state, assembly.work
    state.v[:-1, 5] = rng.normal(size=3)
    move(state, 0.5)
    state.v[:-1, :2], state.v[:-1, 5] = 0.01 * rng.uniform(-1, 1, (3, 2)), rng.normal(size=3)
    move(state, 0.5)
    gaps, d, gap = [], 1e-6, np.zeros(4)
    for dt in (d, -2 * d):
        move(state, dt)
        find_contacts(contacts, state.x, state.R, gap, work.sites.point, work.sites.frame)
        gaps.append(gap.copy())
    move(state, d)
    find_contacts(contacts, state.x, state.R, gap, work.sites.point, work.sites.frame)
    frames = work.sites.frame
    np.testing.assert_allclose(frames @ frames.swapaxes(1, 2), np.tile(np.eye(3), (4, 1, 1)), atol=1e-12)
    same = np.abs(gaps[0] - gaps[1]) < 0.01  # not where a tooth has passed
    rates = (gaps[0] - gaps[1]) / (2 * d)
    assert row_velocities(assembly)[same, 0] == pytest.approx(rates[same], rel=1e-5, abs=1e-6)


def test_teeth_may_yield():
    """Their stiffness and the inertias are an oscillator; the wheel held, the pinion turns by F / (k a)."""
    data = pair(torque=0.3, stiffness=1e4, damping=20.0)
    data["joints"]["second"]["friction_torque"] = 50.0
    data["phases"] = [{"name": "settle"}]
    data["simulation"]["horizon"] = 5.0
    run = simulate(made(data))
    assert run.status == "ok", run.message
    base = 0.2 * np.cos(ANGLE)
    assert run.responses["pinion_angle"] == pytest.approx(0.3 / base / 1e4 / base, rel=1e-4)
    assert run.responses["backward"] == pytest.approx(0.3 / base, rel=1e-4)


def test_a_wheel_driven_by_teeth_is_not_warned_of():
    """Its load comes through them, and no run has to wait for their backlash; without friction the two never rest."""
    data = pair(backlash=0.02, torque=0.03)
    data["phases"] = [{"name": "settle"}]
    (warning,) = cautions(made(data))
    assert "it never comes to rest" in str(warning)
    data["joints"]["second"]["friction_torque"] = 1.0
    assert cautions(made(data)) == []


def test_gears_that_cannot_mesh_are_refused_with_what_is_allowed():
    """Each message begins with the key."""
    far = pair()
    far["bodies"]["wheel"]["origin"] = far["joints"]["second"]["bearing"]["point"] = [0.7, 0, 0]
    assert fault(far).startswith("couplings.mesh.gears: the axes are 0.7 m apart")
    tilted = pair()
    tilted["couplings"]["mesh"]["gears"][0]["axis"] = [0.1, 0, 1]
    assert fault(tilted).startswith("couplings.mesh.gears: the axes are inclined")
    near = pair()
    near["bodies"]["wheel"]["origin"] = near["joints"]["second"]["bearing"]["point"] = [0.595, 0, 0]
    near["simulation"]["assembly_travel"] = 0.0
    with pytest.raises(Exception, match=r"couplings\.mesh\.backlash"):
        assemble(made(near))
    rings = pair(True)
    rings["couplings"]["mesh"]["gears"][0]["internal"] = True
    assert "one ring at most" in fault(rings)
    small_ring = pair(True)
    small_ring["couplings"]["mesh"]["gears"][1]["teeth"] = 20
    assert fault(small_ring).startswith("couplings.mesh.gears.1.teeth")
    alone = pair()
    alone["couplings"]["mesh"]["gears"][1]["body"] = "pinion"
    assert "both sides are on pinion" in fault(alone)
    missing = pair()
    missing["couplings"]["mesh"]["gears"][1]["body"] = "weel"
    assert fault(missing).startswith("couplings.mesh.gears.1.body")
    assert fault(pair(backlash=0.0)).startswith("couplings.mesh.backlash")
    assert "never touch" in fault(pair(backlash=0.02 * np.pi))
    both = pair()
    both["couplings"]["mesh"]["terms"] = [{"joint": "first", "factor": 1}, {"joint": "second", "factor": 2}]
    assert "exactly one of terms" in fault(both)
