"""Responses of whole runs: peaks, events and forces during the motion, against closed forms."""

from typing import Any

import numpy as np
import pytest

from engine import simulate
from engine.mechanism import Mechanism, set_values
from engine.mechanism.keys.values import settable_numbers
from tests.engine.small import GRAVITY, block_on_floor, coordinates, made, small

SPEED, TOP = 2.0, 2.0**2 / (2 * GRAVITY)
STEP = 1e-3


def thrown(**responses: Any) -> Mechanism:
    """Throw a ball upwards, for 0.3 s and then on until 0.5 s; ``z`` is its height."""
    return made(
        small(
            gravity=[0, 0, -GRAVITY],
            parameters={"scale": 2.0} if "back" in responses else {},
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


def test_a_formula_is_computed_from_reported_values_and_parameters():
    """Height of the throw from the speed at the start, v^2 / 2g, with a parameter that a campaign may set."""
    z = coordinates("ball")["z"]
    mechanism = thrown(
        top={**z, "at": "maximum"},
        v_0={"type": "velocity", "to": z["to"], "direction": z["direction"], "at": "maximum"},
        back={"type": "formula", "formula": "-top / scale"},
        share={"type": "formula", "formula": "v_0 ** 2 / top"},
        twice={"type": "difference", "of": ["top", "back"]},
    )
    scaled = set_values(mechanism, {"parameters.scale": 4.0})
    run, other = simulate(mechanism), simulate(scaled)
    assert run.status == other.status == "ok", run.message
    assert run.units["back"] == "m"
    assert run.units["share"] == "m/s2"
    assert run.responses["back"] == -run.responses["top"] / 2
    assert other.responses["back"] == -run.responses["top"] / 4
    assert run.responses["twice"] == pytest.approx(1.5 * TOP, rel=1e-5)
    assert run.responses["share"] == pytest.approx(2 * GRAVITY, rel=1e-5)
    assert mechanism.formulas == {}
    assert "used in responses" in next(n.description for n in settable_numbers(mechanism, "parameters.scale"))


def test_a_formula_without_a_value_is_named():
    """The x of the ball is always 0."""
    run = simulate(thrown(ratio={"type": "formula", "formula": "z / x"}))
    assert run.status == "invalid"
    assert run.message == "ratio: its formula, z / x, has no finite value at z = -0.22625, x = 0"
