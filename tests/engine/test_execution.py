"""A run ends at rest where contact forces hold the pose; where bodies only begin to move, it goes on."""

import math
from typing import Any

import numpy as np
import pytest

from engine import Recording, read_trajectory, simulate
from engine.assembly import assemble
from engine.equilibrium import PoseAtRest
from tests.engine.small import GRAVITY, block_on_floor, made

SLOPE, FRICTION, WAY = 0.5, 0.1, 0.05  # rad, 1, m to the stop
PUSH = 2.0 * GRAVITY * (math.sin(SLOPE) - FRICTION * math.cos(SLOPE))  # N that friction leaves along the slope
AT_STOP = math.sqrt(2 * WAY * 2.0 / PUSH)  # s


def block_above_a_stop(**tables: Any) -> dict[str, Any]:
    """Describe a block at the start of its slide to a stop, with a rest so coarse that it seems to stand still."""
    data = block_on_floor(friction=FRICTION, origin=[0, 0, 0.1])
    data["gravity"] = [GRAVITY * math.sin(SLOPE), 0, -GRAVITY * math.cos(SLOPE)]
    data["simulation"]["rest"] = {"window": 2e-3, "drift": 1e-3}
    data["contacts"]["stop"] = {
        "a": {"body": "block", "point": [0.3, 0, -0.1]},
        "b": {"body": "ground", "plane": {"point": [0.3 + WAY, 0, 0], "normal": [-1, 0, 0]}},
        "friction": 0.0,
    }
    data["responses"]["force"] = {"type": "contact_force", "contact": "stop"}
    return data | tables


def test_a_block_that_has_only_begun_to_slide_goes_on_to_its_stop():
    """Unmoved for the window, and for some more, it is held by nothing; it rests at the stop, which holds it."""
    run = simulate(made(block_above_a_stop()))
    assert run.status == "ok", run.message
    assert run.responses["x"] == pytest.approx(WAY, abs=1e-6)
    assert PUSH - 1e-6 <= run.responses["force"] <= PUSH / (1 - FRICTION / math.tan(SLOPE)) + 1e-6
    assert run.certificate.settled
    assert AT_STOP < run.certificate.time < 1.0


@pytest.mark.parametrize("every", [1, 3])
def test_a_recording_of_a_run_that_goes_on_has_every_instant_once(every, tmp_path):
    """Its rows have no seam where the pose was looked at; the run is the same to the bit."""
    mechanism, path = made(block_above_a_stop()), tmp_path / "run.h5"
    plain = simulate(mechanism)
    recorded = simulate(mechanism, trajectory=Recording(path, every=every))
    assert recorded.measured == plain.measured
    time = read_trajectory(path).time
    assert time[-1] == recorded.certificate.time == plain.certificate.time
    np.testing.assert_allclose(np.diff(time)[:-1], every * 1e-3, rtol=1e-9)


def test_a_phase_with_a_duration_is_not_made_longer():
    """Its end is its end: nothing holds the block there."""
    run = simulate(made(block_above_a_stop(phases=[{"name": "look", "duration": 4e-3}])))
    assert run.certificate.time == pytest.approx(4e-3)
    assert run.status == "not_at_rest"
    assert "no contact forces hold the pose: block slides along +x" in run.message


def test_the_whole_horizon_is_simulated_once():
    """Without an end at rest, what happens until the horizon is the same."""
    mechanism = made(block_above_a_stop())
    whole, early = simulate(mechanism, full_horizon=True), simulate(mechanism)
    assert whole.status == early.status == "ok"
    assert whole.certificate.time == pytest.approx(1.0)
    assert whole.responses["x"] == pytest.approx(early.responses["x"], abs=1e-6)


def test_looking_at_a_pose_leaves_the_run_as_it_is():
    """No array of the motion changes, whether forces hold the pose or not."""
    mechanism = made(block_above_a_stop())
    assembly = assemble(mechanism)
    before = [array.copy() for array in assembly.state]
    pose = PoseAtRest(mechanism, assembly, 0, 0.0, 1e-3)
    assert (pose.moves, pose.forces, pose.ranges(["stop"])) == (True, None, {})
    assert math.isnan(pose.reported[list(mechanism.responses).index("force")])
    for array, kept in zip(assembly.state, before, strict=True):
        np.testing.assert_array_equal(array, kept)


def test_without_a_force_to_measure_nothing_is_asked():
    """Lengths at rest are what they are: the run ends with the first window in which nothing moves."""
    data = block_above_a_stop()
    del data["responses"]["force"]
    run = simulate(made(data))
    assert run.status == "ok"
    assert run.certificate.time < 4e-3
