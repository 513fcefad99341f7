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


def test_impulses_and_means_over_windows_of_time():
    """Thrown with SPEED: z = v t - g t^2 / 2, so its mean over [a, b] is v (b + a) / 2 - g (a^2 + ab + b^2) / 6.

    Windows begin and end within steps.
    """
    a, b, c = 0.1 + 0.3e-3, 0.25 + 0.7e-3, 0.3
    mechanism = thrown(
        all={"type": "mean", "response": "z"},
        some={"type": "mean", "response": "z", "window": [a, b]},
        later={"type": "mean", "response": "z", "from_phase": "down", "window": [0.05, 9.0]},
        up={"type": "mean", "response": "z", "to_phase": "up"},
        crossing={"type": "mean", "response": "z", "at": {"response": "z", "above": TOP / 2}},
    )
    run = simulate(mechanism)
    assert run.status == "ok", run.message

    def mean(a: float, b: float) -> float:
        return SPEED * (a + b) / 2 - GRAVITY * (a * a + a * b + b * b) / 6

    risen = SPEED / GRAVITY * (1 - np.sqrt(0.5))
    expected = {"all": (0.0, 0.5), "some": (a, b), "later": (c + 0.05, 0.5), "up": (0.0, c), "crossing": (0.0, risen)}
    for name, window in expected.items():
        assert run.responses[name] == pytest.approx(mean(*window), abs=2e-6), name
    assert run.units["all"] == "m"


def test_a_mean_whose_window_never_begins_is_named():
    """The run ends before."""
    run = simulate(thrown(late={"type": "mean", "response": "z", "window": [0.6, 0.7]}))
    assert run.status == "invalid"
    assert run.message.startswith("late: the run ended before its window began")


def test_impulses_of_forces_are_the_momentum_they_give():
    """A block falls on a floor: what the floor gives it in 0.6 s is m g t; the mean at rest is its weight."""
    data = block_on_floor(mass=2.0, origin=[0, 0, 0.1 + 0.05])
    data["phases"] = [{"name": "fall", "duration": 0.4}, {"name": "lie", "duration": 0.2}]
    corners = [f"corner_{i}" for i in range(8)]
    data["responses"] |= {f"f_{c}": {"type": "contact_force", "contact": c} for c in corners}
    data["responses"] |= {f"i_{c}": {"type": "impulse", "response": f"f_{c}"} for c in corners}
    rests = {"from_phase": "lie", "window": [0.05, 0.15]}
    data["responses"] |= {f"m_{c}": {"type": "mean", "response": f"f_{c}", **rests} for c in corners}
    data["responses"]["one"] = {"type": "contact_impulse", "contact": "corner_0"}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert sum(run.responses[f"i_{c}"] for c in corners) == pytest.approx(2.0 * GRAVITY * 0.6, rel=1e-9)
    assert sum(run.responses[f"m_{c}"] for c in corners) == pytest.approx(2.0 * GRAVITY, rel=1e-6)
    assert run.responses["one"] == pytest.approx(run.responses["i_corner_0"], rel=1e-12)
    assert not {name for name in run.at_impact if name.startswith(("i_", "m_"))}


@pytest.mark.parametrize(("opening", "expected"), [(0.02, 2), (0.004, 4), (0.001, 6)])
def test_bounces_are_counted_by_how_far_the_contact_opens(opening, expected):
    """Dropped from 0.1 m, each bounce is e^2 = 0.49 as high: 0.049, 0.024, 0.012, 0.0058, 0.0028, 0.0014, ... m.

    Impacts are at t0 (1 + 2e + 2e^2 + ...), t0 = 0.1428 s; the sixth is at 0.697 s.
    """
    data = small(
        gravity=[0, 0, -GRAVITY],
        phases=[{"name": "run", "duration": 0.72}],
        bodies={"ground": {"fixed": True}, "ball": {"mass": 1.0, "inertia": [1, 1, 1], "origin": [0, 0, 0.2]}},
        contacts={
            "floor": {
                "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": 0.1}},
                "b": {"body": "ground", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}},
                "friction": 0.0,
                "restitution": 0.7,
            }
        },
        responses={
            "n": {"type": "bounces", "contact": "floor", "opening": opening},
            "second": {"type": "time", "at": {"response": "n", "above": 1.5}},
        },
    )
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["n"] == expected
    fall = np.sqrt(2 * 0.1 / GRAVITY)
    if opening == 0.004:
        rising = 0.7**2 * np.sqrt(2 * GRAVITY * 0.1)
        passed = (rising - np.sqrt(rising**2 - 2 * GRAVITY * opening)) / GRAVITY
        assert run.responses["second"] == pytest.approx(fall * (1 + 2 * 0.7) + passed, abs=3e-3)
