"""Responses of whole runs: peaks, events and forces during the motion, against closed forms."""

from typing import Any

import numpy as np
import pytest

from engine import simulate
from engine.mechanism import Mechanism
from tests.engine.small import GRAVITY, block_on_floor, coordinates, made, small

SPEED, TOP = 2.0, 2.0**2 / (2 * GRAVITY)
STEP = 1e-3


def thrown(**responses: Any) -> Mechanism:
    """Throw a ball upwards, for 0.3 s and then on until 0.5 s; ``z`` is its height."""
    return made(
        small(
            gravity=[0, 0, -GRAVITY],
            phases=[{"name": "up", "duration": 0.3}, {"name": "down", "duration": 0.2}],
            bodies={
                "ground": {"fixed": True},
                "ball": {"mass": 1.0, "inertia": [1, 1, 1], "velocity": [0, 0, SPEED], "angular_velocity": [0, 0, 30]},
            },
            responses={**coordinates("ball"), **responses},
        )
    )


def test_peaks_and_events_of_a_thrown_ball():
    """The top is v^2/2g; on the way up z = TOP/2 is passed at v/g (1 - 1/sqrt(2)), on the way down at the mirror."""
    half = {"response": "z", "above": TOP / 2}
    later = {"at": {"response": "z", "below": TOP / 2}, "from_phase": "down"}
    z = coordinates("ball")["z"]
    speed = {"type": "velocity", "to": z["to"], "direction": z["direction"]}
    run = simulate(
        thrown(
            top={**z, "at": "maximum"},
            deepest={**z, "at": "minimum", "from_phase": "down"},
            rises={"type": "time", "at": half},
            speed={**speed, "at": half},
            falls={"type": "time", **later},
            end={"type": "time"},
            slowest={**speed, "at": "minimum"},
            turned={"type": "angle", "body": "ball", "axis": [0, 0, 1]},
            spin={
                "type": "angular_velocity",
                "body": "ball",
                "axis": [0, 0, 1],
                "at": {"response": "end", "above": 0.1},
            },
        )
    )
    assert run.status == "ok", run.message
    found = run.responses
    expected = {
        "top": TOP,
        "deepest": SPEED * 0.5 - GRAVITY * 0.5**2 / 2,
        "rises": SPEED / GRAVITY * (1 - np.sqrt(0.5)),
        "speed": SPEED * np.sqrt(0.5),
        "falls": SPEED / GRAVITY * (1 + np.sqrt(0.5)),
        "end": 0.5,
        "slowest": SPEED - GRAVITY * 0.5,
        "turned": 15.0,
        "spin": 30.0,
    }
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, abs=GRAVITY * STEP**2), name


def test_an_event_that_does_not_happen_has_no_value_and_the_message_names_it():
    """The ball does not rise above its top."""
    run = simulate(thrown(never={"type": "time", "at": {"response": "z", "above": 1.01 * TOP}}))
    assert (run.status, run.responses) == ("invalid", {})
    assert "never" in run.message
    assert np.isnan(run.measured["never"])
    assert run.measured["z"] == pytest.approx(SPEED * 0.5 - GRAVITY * 0.5**2 / 2, abs=1e-9)


def test_forces_of_sliding_and_at_rest():
    """A brick that slides is rubbed with mu m g, and at rest on a level floor with nothing."""
    data = block_on_floor(friction=0.4, origin=[0, 0, 0.1], velocity=[1.0, 0, 0], mass=2.0)
    corners = [
        f"corner_{i}" for i, z in enumerate(contact["a"]["point"][2] for contact in data["contacts"].values()) if z < 0
    ]
    for name in corners:
        force = {"type": "contact_force", "contact": name}
        data["responses"] |= {f"{name}_N": {**force, "at": {"response": "clock", "above": 0.1}}}
        data["responses"] |= {
            f"{name}_T": {**force, "component": "friction", "at": {"response": "clock", "above": 0.1}}
        }
        data["responses"] |= {f"{name}_rest": {**force, "component": "friction"}}
    data["responses"] |= {"clock": {"type": "time"}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    sums = {end: sum(run.responses[name + end] for name in corners) for end in ("_N", "_T", "_rest")}
    assert sums["_N"] == pytest.approx(2.0 * GRAVITY, rel=1e-6)
    assert sums["_T"] == pytest.approx(0.4 * 2.0 * GRAVITY, rel=1e-6)
    assert sums["_rest"] == pytest.approx(0.0, abs=1e-6)
