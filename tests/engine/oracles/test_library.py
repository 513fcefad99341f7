"""The shipped mechanisms: each runs, closed joints stay closed, nothing passes; known answers where there are some."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.chain import chain
from engine import library_names, load_mechanism, simulate
from tests.each import each
from tests.engine.oracles.reference import recorded
from tests.engine.small import made, shipped, turned

MM = {"SI": 1e-3, "mm-g-ms": 1.0}


@each("name", library_names())
def test_it_runs_within_its_certificate(name):
    """Status ok; after every step gaps hold to 1e-8 mm, ideal joints to 1e-10 mm, friction to 1e-8.

    But for what the plain scheme lets drift.
    """
    mechanism = load_mechanism(name)
    run = simulate(mechanism)
    assert run.status == "ok", run.message
    assert run.certificate.max_residual <= 1e-8
    if mechanism.simulation.scheme == "combined":
        assert run.certificate.max_penetration <= 1e-8 * MM[mechanism.units]
        assert run.certificate.max_violation <= 1e-10 * MM[mechanism.units]


@pytest.mark.slow
@each("name", [name for name in library_names() if name != "c60"])
def test_it_is_the_same_elsewhere(name):
    """Moved by a metre, turned, in another order: as many steps, and responses to 5e-6 of their units.

    The C-60 in ON has a test with `test_step_lengths`.
    """
    data = shipped(name)
    if name == "c60_public":  # until its contacts have opened: then its parts rattle on
        data["phases"][-1]["duration"] = 5.0
    if name == "lever":  # an expression cannot be turned
        data["forces"]["load"]["force"] = [0.0, -data["parameters"].pop("load"), 0.0]
    metre = np.array([0.6, -0.64, 0.48]) * (1.0 if data["units"] == "SI" else 1e3)
    backwards = data | {
        table: dict(reversed(data[table].items()))
        for table in {"bodies", "joints", "contacts", "springs"} & data.keys()
    }
    # the peak of what opens this latch is 2 N m, in N mm, where friction changes its way: to 1e-6 of it
    of_size = 5e-6 if name == "door_latch" else 0.0
    here = simulate(made(data))
    for other in (
        turned(data, Rotation.from_rotvec([0.0, 0.0, 1e-9]), metre),
        turned(data, Rotation.from_rotvec([0.4, -0.9, 0.5]), np.zeros(3)),
        backwards,
    ):
        there = simulate(made(other))
        assert (there.status, there.certificate.steps) == ("ok", here.certificate.steps)
        for response in here.responses:
            assert there.responses[response] == pytest.approx(here.responses[response], rel=of_size, abs=5e-6), response


def test_the_shipped_chain_is_the_generated_one_of_ten_links():
    """The file and `benchmarks.chain` describe the same mechanism."""
    assert load_mechanism("chain").digest() == made(chain(10)).digest()


def test_a_long_chain_with_play_needs_few_iterations():
    """100 links that rattle: 26 a step.

    With a problem for each contact that closes they are 37, without the interior-point method's end 51 and more.
    """
    data = chain(100)
    data["simulation"]["horizon"] = data["phases"][0]["duration"] = 0.05
    run = simulate(made(data), full_horizon=True)
    assert run.status == "ok", run.message
    assert run.certificate.iterations < 32 * run.certificate.steps


def test_a_chain_of_ideal_joints_keeps_its_energy():
    """Without play and friction, 20 links: joints closed to 1e-13 m, energy kept to 1e-4 of what swings."""
    run = recorded(chain(20, clearance=0.0))
    energy = run.kinetic + run.potential
    assert np.abs(energy - energy[0]).max() < 1e-4 * run.kinetic.max()
    assert run.certificate["max_violation"] <= 1e-13


def rocker_angle(crank, a=0.1, b=0.26, c=0.2, d=0.3):
    """Return the rocker's angle of the four-bar without play, from the crank's (Freudenstein)."""
    x, y = d - a * np.cos(crank), -a * np.sin(crank)
    reach = np.hypot(x, y)
    return np.pi - np.arctan2(-y, x) - np.arccos((c**2 + reach**2 - b**2) / (2 * c * reach))


def rocker_play(crank, clearance, c=0.2):
    """Return how far three clearances can turn the rocker: all along the coupler, over its lever arm on the rocker."""
    psi = rocker_angle(crank)
    coupler = np.arctan2(c * np.sin(psi) - 0.1 * np.sin(crank), 0.3 + c * np.cos(psi) - 0.1 * np.cos(crank))
    return 3 * clearance / (c * np.abs(np.sin(psi - coupler)))


def test_four_bar_follows_its_geometry_within_the_play():
    """The driven crank is exact; the rocker is off the tight linkage by what three clearances allow, or half of it."""
    data = shipped("four_bar")
    run = recorded(data)
    crank, rocker = run.responses["crank"], run.responses["rocker"]
    np.testing.assert_allclose(crank, np.pi / 2 + 10.0 * run.time, rtol=0, atol=1e-10)
    off, most = np.abs(rocker - rocker_angle(crank)), rocker_play(crank, 1e-4)
    assert (off < 1.02 * most).all()
    assert (off > 0.5 * most).any()


def test_a_rolling_ball_at_rest_for_the_eye_keeps_its_speed():
    """A run in which only speeds are read counts as at rest when the ball rolls; its speed is still reported."""
    data = shipped("sphere_roll")
    del data["responses"]["way"]
    run = simulate(made(data))
    assert run.certificate.settled
    assert run.responses["speed"] == pytest.approx(10 / 7, abs=1e-9)
    assert run.responses["friction"] == pytest.approx(0.0, abs=1e-6)
