"""Whole runs of small mechanisms against closed forms, and what a run says when it fails."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine import MechanismError, load_mechanism, set_values, simulate
from tests.engine.histories import history
from tests.engine.small import (
    CORNERS,
    FLOOR,
    GRAVITY,
    block_on_floor,
    coordinates,
    made,
    shipped,
    small,
    swinging,
    tumbling,
)

SLOPE = np.pi / 6


# --- friction


def test_block_on_the_slope_sticks_without_creep():
    """Friction 0.7 above tan 30 degrees: not 1e-9 m in 1 s, and at rest at once."""
    run = simulate(load_mechanism("incline"), full_horizon=True)
    assert (run.status, run.certificate.steps) == ("ok", 1000)
    assert abs(run.responses["slide"]) < 1e-9
    assert simulate(load_mechanism("incline")).certificate.time < 0.1


@pytest.mark.parametrize("above", [1.0001, 1.01])
def test_block_just_above_the_limit_of_friction_sticks(above):
    """Friction a hair above tan 30 degrees is still sticking."""
    run = simulate(
        load_mechanism("incline"), {"materials.block_slope.friction": above * np.tan(SLOPE)}, full_horizon=True
    )
    assert abs(run.responses["slide"]) < 1e-8


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.55])
@pytest.mark.parametrize("h", [2e-3, 1e-3])
def test_block_slides_as_coulomb_says(friction, h):
    """Below: 1/2 g (sin - mu cos) t^2 after 0.5 s, within g h t."""
    run = simulate(
        load_mechanism("incline"), {"materials.block_slope.friction": friction}, step=h, horizon=0.5, full_horizon=True
    )
    way = 0.5 * GRAVITY * (np.sin(SLOPE) - friction * np.cos(SLOPE)) * 0.5**2
    assert run.responses["slide"] == pytest.approx(way, abs=0.5 * GRAVITY * h * 0.5)


def test_thrown_block_stops_after_its_braking_distance():
    """Sliding on the level at 1 m/s: it stops after v^2 / (2 mu g)."""
    data = block_on_floor(half=(0.3, 0.2, 0.02), friction=0.25, origin=[0, 0, 0.02], velocity=[1.0, 0, 0])
    data["simulation"] |= {"horizon": 3.0, "step": 1e-3}
    run = simulate(made(data))
    assert run.status == "ok"
    assert run.responses["x"] == pytest.approx(1 / (2 * 0.25 * GRAVITY), abs=1e-3)
    assert abs(run.responses["y"]) < 1e-6


# --- impact


def bouncing(restitution: float, h: float, horizon: float):
    """Drop a small body without friction, its contact at its centre of mass, from 1 m."""
    data = small(
        gravity=[0, 0, -GRAVITY],
        simulation={"step": h, "horizon": horizon},
        bodies={"ground": {"fixed": True}, "ball": {"mass": 0.2, "inertia": [1, 1, 1], "origin": [0, 0, 1]}},
        contacts={
            "C": {
                "a": {"body": "ball", "point": [0, 0, 0]},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": 0.0,
                "restitution": restitution,
            }
        },
        responses=coordinates("ball"),
    )
    return simulate(made(data), full_horizon=True).responses["z"]


def height(restitution: float, time: float) -> float:
    """Height of the bouncing ball by its parabolas."""
    fall = np.sqrt(2 / GRAVITY)
    if time <= fall:
        return 1 - 0.5 * GRAVITY * time**2
    time, speed = time - fall, restitution * GRAVITY * fall
    while time > 2 * speed / GRAVITY and speed > 1e-9:
        time, speed = time - 2 * speed / GRAVITY, restitution * speed
    return speed * time - 0.5 * GRAVITY * time**2 if speed > 1e-9 else 0.0


@pytest.mark.parametrize("restitution", [0.5, 0.8, 1.0])
def test_bouncing_ball_is_first_order(restitution):
    """Heights over 1.6 s and up to four impacts: off by at most 30 h, whatever the step."""
    for h in (2e-3, 1e-3, 5e-4):
        times = np.arange(0.3, 1.61, 0.1)
        miss = [bouncing(restitution, h, t) - height(restitution, t) for t in times]
        assert np.abs(miss).max() < 30 * h, h
        assert abs(miss[0]) < 1e-9  # before the first impact the parabola is exact


def test_without_restitution_it_stays_where_it_lands():
    """Restitution 0: on the floor after the impact, and for ever."""
    assert abs(bouncing(0.0, 1e-3, 0.6)) < 1e-8


# --- rest


def test_forces_at_rest_carry_the_weight():
    """The four corners under a brick: sum m g to 1e-6, each a quarter by symmetry."""
    data = block_on_floor(origin=[0, 0, 0.1])
    names = [f"corner_{i}" for i, corner in enumerate(CORNERS) if corner[2] < 0]
    data["responses"] = {name: {"type": "contact_force", "contact": name} for name in names}
    run = simulate(made(data))
    assert run.status == "ok"
    assert sum(run.responses.values()) == pytest.approx(2.0 * GRAVITY, rel=1e-6)
    np.testing.assert_allclose(list(run.responses.values()), 0.5 * GRAVITY, rtol=1e-4)
    assert set(run.units.values()) == {"N"}


def test_pendulum_with_play_hangs_one_clearance_low():
    """The shipped pendulum comes to rest straight down, the bore one radial clearance below the bolt."""
    run = simulate(load_mechanism("clearance_pendulum"), {"J1": 3e-4})
    assert run.status == "ok"
    assert run.responses["drop"] == pytest.approx(3e-4, abs=1e-6)
    assert abs(run.responses["tip"]) < 1e-4


# --- energy


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), law=st.sampled_from([(0.0, 0.0), (0.0, 0.6), (0.0, 1.0), (0.5, 0.0), (1.2, 0.0)]))
def test_energy_of_a_thrown_block_never_grows(seed, law):
    """Thrown, tumbling, landing on its corners: no step gains energy but by the scheme's own second-order terms.

    The impulse works on the mean of the velocities before and after, both at the corner of mid-step: a corner that
    the block turns about gains up to half its centripetal acceleration times h, and the bend of its path in half a
    step is pushed out of the floor. With restitution an impact is found late, and the block lifted by what it sank.
    """
    friction, restitution = law
    rng = np.random.default_rng(seed)
    data = block_on_floor(
        friction=friction,
        restitution=restitution,
        origin=[0, 0, 0.5],
        axis=rng.normal(size=3).tolist(),
        angle=float(rng.uniform(0.1, 3)),
        velocity=rng.normal(size=3).tolist(),
        angular_velocity=(5 * rng.normal(size=3)).tolist(),
    )
    data["simulation"] |= {"step": 2e-3, "horizon": 0.8}
    run = history(made(data))
    h, twist, impulse = 2e-3, run.v[:, 0], np.linalg.norm(run.r[1:], axis=2).sum(1)
    np.testing.assert_allclose(run.step[1:], h)
    assert (impulse > 0).any()
    size, reach = run.energy[0], float(np.linalg.norm([0.3, 0.2, 0.1]))
    spin = np.linalg.norm(twist[:, 3:], axis=1)
    spin = np.maximum(spin[1:], spin[:-1])
    gain = (0.5 * h * impulse + 2.0 * GRAVITY * h**2 / 8) * reach * spin**2
    if restitution:
        gain += (impulse > 0) * 2.0 * GRAVITY * h * (np.linalg.norm(twist[:-1, :3], axis=1) + reach * spin)
    assert (np.diff(run.energy) <= 1.1 * gain + 1e-7 * size).all()


# --- what a run says


def test_horizon_too_short_is_not_at_rest():
    """Moving at the horizon: no responses, a message that names the remedy; measured values are kept."""
    run = simulate(load_mechanism("clearance_pendulum"), horizon=0.2)
    assert (run.status, run.responses, run.certificate.settled) == ("not_at_rest", {}, False)
    assert "not at rest at the horizon of 0.2 s" in run.message
    assert "simulation.horizon" in run.message
    assert set(run.measured) == {"drop", "tip"}


def test_phase_with_a_duration_needs_no_rest():
    """A last phase of given length ends ok though everything moves."""
    data = shipped("clearance_pendulum")
    data["phases"] = [{"name": "swing", "duration": 0.2}]
    run = simulate(made(data))
    assert (run.status, run.certificate.settled) == ("ok", False)
    assert run.certificate.time == pytest.approx(0.2)


def test_wall_limit_is_a_timeout():
    """A run is stopped by its wall limit, and says where it was."""
    mechanism = load_mechanism("c60")
    run = simulate(mechanism, {"simulation.wall_limit": 1e-3})
    assert (run.status, run.responses) == ("timeout", {})
    assert "simulation.wall_limit" in run.message
    assert "at step" in run.message
    assert run.certificate.time < mechanism.simulation.horizon


def test_broken_validity_condition_is_invalid():
    """A result outside its validity is no result; the message has the condition and the value."""
    data = shipped("incline")
    data["validity"] = ["slide > 1"]
    run = simulate(made(data))
    assert (run.status, run.responses) == ("invalid", {})
    assert "slide > 1 is broken: slide = " in run.message


def test_tolerance_out_of_reach_is_not_converged():
    """A residual below rounding cannot be reached: a failure with the residual and the key, not a result."""
    data = shipped("incline")
    data["materials"]["block_slope"]["friction"] = 0.3
    data["simulation"]["tolerance"] = 1e-99
    run = simulate(made(data))
    assert run.status == "not_converged"
    assert "friction problem: residual" in run.message
    assert "simulation.tolerance = 1e-99" in run.message


@pytest.mark.parametrize("value", [0.0, -0.1, 0.003, float("nan")])
def test_bad_clearance_names_key_value_and_bounds(value):
    """Zero, negative, beyond the bore, not a number."""
    with pytest.raises(MechanismError, match=r"J1 = .*allowed") as caught:
        simulate(load_mechanism("clearance_pendulum"), {"J1": value})
    if value == value:
        assert "0 < radial_clearance <= 0.002" in str(caught.value)


def test_overlap_of_a_contact_at_the_start_names_it():
    """A block started 1 cm inside the slope: its contact, the gap, and what is allowed."""
    data = block_on_floor(origin=[0, 0, 0.09])
    with pytest.raises(MechanismError, match="overlap") as caught:
        simulate(made(data))
    assert "contacts.corner_0: gap -0.01 m at the start; allowed: >= 0" in str(caught.value)
    assert "corner_1:" not in str(caught.value)  # an upper corner


def test_journal_outside_its_bore_names_the_joint():
    """A journal that starts 1 mm off in a bore of 0.5 mm play: its joint and the clearance that would do."""
    data = shipped("clearance_pendulum")
    data["bodies"]["link"]["origin"] = [1e-3, 0, 0]
    data["simulation"]["assembly_travel"] = 0.0
    with pytest.raises(MechanismError, match=r"joints\.J1\.radial_clearance = 0\.0005 m.*0\.001 m"):
        simulate(made(data))


def test_certificate_holds_what_was_asked_for():
    """Residual and penetration within the file's bounds, steps times step is the time."""
    certificate = simulate(made(tumbling()), full_horizon=True).certificate
    assert 0 < certificate.max_residual <= 1e-11
    assert certificate.max_penetration <= 1e-8
    assert certificate.steps == 250
    assert certificate.time == pytest.approx(0.5)
    assert certificate.iterations > 0


@pytest.mark.bits
def test_a_run_leaves_its_mechanism_as_it_was():
    """Values are for one run: the same mechanism again gives the same bits."""
    mechanism = made(swinging())
    first = simulate(mechanism, full_horizon=True).responses
    simulate(mechanism, {"J1": 1e-3}, full_horizon=True)
    assert simulate(mechanism, full_horizon=True).responses == first
    assert simulate(set_values(mechanism, {"J1": 1e-3}), full_horizon=True).responses != first
