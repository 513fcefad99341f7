"""A driven four-bar with play at one pin, against an integration with exactly located events."""

from typing import Any

import numpy as np
import pytest

from engine import Trajectory
from tests.engine.oracles.four_bar_by_events import (
    CRANK,
    GRAVITY,
    INERTIA,
    MASS,
    PLAY,
    SPEED,
    START,
    Instant,
    closed,
    run,
)
from tests.engine.oracles.reference import order, recorded
from tests.engine.small import shipped

UNTIL = 0.3  # s, half a turn of the crank
PRESSED = 0.05  # s, from then on the pin follows its bore


def four_bar() -> dict[str, Any]:
    """Take the shipped four-bar, with play at the pin between coupler and rocker alone and without friction."""
    data = shipped("four_bar")
    for name in ("J1", "J3"):
        data["joints"][name]["type"] = "revolute"
    data["joints"]["J2"] |= {"radial_clearance": PLAY, "friction": 0.0, "rings": [0.0]}
    for key in ("flanges", "axial_clearance", "material"):
        del data["joints"]["J2"][key]
    data["phases"][0]["duration"] = data["simulation"]["horizon"] = UNTIL
    data["responses"] = {
        "coupler": {"type": "angle", "body": "coupler", "axis": [0, 0, 1], "offset": closed(START)[0]},
        "rocker": {"type": "angle", "body": "rocker", "axis": [0, 0, 1], "offset": closed(START)[1]},
        "force": {"type": "joint_force", "joint": "J2"},
    }
    return data


@pytest.fixture(scope="module")
def exact() -> list[Instant]:
    """Integrate from the centred pin, with the speeds of the four-bar without play."""
    small = 1e-6
    rates = (np.array(closed(START + small)) - closed(START - small)) / (2 * small) * SPEED
    instants, events = run(np.array([*closed(START), *rates]), UNTIL)
    assert [kind for _, kind in events] == ["strikes"]
    return instants


def errors(exact: list[Instant], data: dict[str, Any], step: float | None) -> list[float]:
    """Return the largest errors of the angles and of the energy, and that of the impulse of the pin's force."""
    motion, time = recorded(data, step), np.array([now.t for now in exact])
    crank = 0.5 * (INERTIA["crank"] + 0.25 * MASS["crank"] * CRANK**2) * SPEED**2
    crank = crank + 0.5 * MASS["crank"] * GRAVITY * CRANK * np.sin(START + SPEED * time)
    found = [np.interp(time, motion.time, values) for values in (*angles(motion), motion.kinetic + motion.potential)]
    expected = [*np.array([now.y[:2] for now in exact]).T, crank + [now.energy() for now in exact]]
    pressed, late = motion.time > PRESSED, time > PRESSED - 1e-9
    impulse = np.sum(motion.responses["force"][pressed] * np.diff(motion.time, prepend=0.0)[pressed])
    needed = np.trapezoid([now.force() for now in np.array(exact)[late]], time[late])
    return [*(float(np.abs(a - b).max()) for a, b in zip(found, expected, strict=True)), abs(float(impulse - needed))]


def angles(motion: Trajectory) -> list[np.ndarray]:
    """Return the angles of coupler and rocker."""
    return [motion.responses["coupler"], motion.responses["rocker"]]


@pytest.mark.slow
def test_it_is_of_first_order_in_the_step(exact):
    """Angles, energy and the impulse of the pin's force, from the first impact on."""
    steps = [8e-4, 4e-4, 2e-4, 1e-4]
    found = np.array([errors(exact, four_bar(), step) for step in steps])
    for column in found[:, :3].T:
        assert 0.85 < order(steps, column.tolist()) < 1.15
    assert (found[-1] < [6e-5, 6e-5, 1.5e-4, 5e-4]).all()


def test_adaptive_steps_are_as_good(exact):
    """Of up to 0.4 ms, with the impact at 0.02 ms."""
    data = four_bar()
    data["simulation"] |= {"step": 2e-5, "adaptive": {"longest": 4e-4, "travel": 2e-4}}
    assert (np.array(errors(exact, data, None)) < [8e-5, 1e-4, 2.5e-4, 1e-3]).all()
