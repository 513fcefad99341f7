"""Forces at impacts are marked, because they depend on the step; impulses and means of forces do not."""

import math
from typing import Any

import pytest

from engine import simulate
from engine.run import Run
from tests.engine.small import FLOOR, GRAVITY, made, small

MASS, SPEED, OVER = 2.0, 3.0, 0.02  # kg, m/s, s
TOUCH = {"contact": "floor"}
READ = {
    "peak": {"type": "contact_force", **TOUCH, "at": "maximum"},
    "height": {
        "type": "position",
        "to": {"body": "ball", "point": [0, 0, 0]},
        "from": {"body": "ground", "point": [0, 0, 0]},
        "direction": {"vector": [0, 0, 1]},
        "at": {"response": "force", "peak": "maximum"},
    },
    "force": {"type": "contact_force", **TOUCH},
    "mean": {"type": "contact_force", **TOUCH, "at": "maximum", "averaged_over": OVER},
    "impulse": {"type": "contact_impulse", **TOUCH},
    "later": {"type": "contact_impulse", **TOUCH, "from_phase": "rest"},
    "change": {"type": "difference", "of": ["peak", "force"]},
}


def strike(step: float, responses: dict[str, Any] = READ) -> Run:
    """Run a ball that strikes a floor without bounce after 0.05 s, and rests on it from 0.1 s on."""
    ball = {"mass": MASS, "inertia": [1, 1, 1], "origin": [0, 0, 0.1 + 0.0501 * SPEED], "velocity": [0, 0, -SPEED]}
    sphere = {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": 0.1}}
    contact = {"a": sphere, "b": {"body": "ground", "plane": FLOOR}, "friction": 0.2}
    data = small(
        bodies={"ground": {"fixed": True}, "ball": ball},
        contacts={"floor": contact},
        forces={"weight": {"body": "ball", "force": [0, 0, -MASS * GRAVITY], "phases": ["rest"]}},
        phases=[{"name": "strike", "duration": 0.1}, {"name": "rest", "duration": 0.2}],
        responses=responses,
        simulation={"step": step},
    )
    run = simulate(made(data))
    assert run.status == "ok", run.message
    return run


def test_a_peak_at_an_impact_is_marked_and_what_does_not_depend_on_the_step_is_not():
    """The peak is m v / h; the impulse is m v; the mean over T rises to m v / T."""
    for step in (1e-3, 5e-4, 2.5e-4):
        run = strike(step)
        assert run.responses["peak"] == pytest.approx(MASS * SPEED / step, rel=1e-6)
        assert run.responses["impulse"] == pytest.approx(MASS * (SPEED + 0.2 * GRAVITY), rel=1e-6)
        assert run.responses["later"] == pytest.approx(MASS * 0.2 * GRAVITY, rel=1e-6)
        expected = MASS * SPEED * -math.expm1(-step / OVER) / step
        assert run.responses["mean"] == pytest.approx(expected, rel=1e-6)
        assert expected == pytest.approx(MASS * SPEED / OVER, rel=step / OVER)
        assert run.responses["force"] == pytest.approx(MASS * GRAVITY, rel=1e-6)
        assert run.at_impact == ("peak", "height", "change")
        assert len(run.remarks) == 3


def test_a_mean_over_no_more_than_a_step_is_marked():
    """It is the force of the step."""
    assert strike(1e-3, {"mean": READ["mean"] | {"averaged_over": 1e-4}}).at_impact == ("mean",)


def test_a_load_that_grows_or_comes_at_once_is_no_impact():
    """Nothing closes: a ball on the floor under a load that begins with a phase, and one that swells."""
    law = {"table": [[0.0, 0.0], [0.05, 1.0], [0.1, 0.2]]}
    data = small(
        gravity=[0, 0, -GRAVITY],
        bodies={"ground": {"fixed": True}, "ball": {"mass": MASS, "inertia": [1, 1, 1], "origin": [0, 0, 0.1]}},
        contacts={
            "floor": {
                "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": 0.1}},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": 0.2,
            }
        },
        forces={
            "at_once": {"body": "ball", "force": [0, 0, -50.0], "phases": ["loaded"]},
            "swells": {"body": "ball", "force": [0, 0, -100.0], "law": law, "phases": ["loaded"]},
        },
        phases=[{"name": "settle"}, {"name": "loaded", "duration": 0.1}],
        responses={"peak": READ["peak"]},
    )
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["peak"] == pytest.approx(MASS * GRAVITY + 150.0, rel=0.02)
    assert run.at_impact == ()


def test_the_peak_of_a_slow_drive_is_a_property():
    """A spring pressed against a ball by a slow motion closes the gap long before its force is largest."""
    data = small(
        bodies={
            "ground": {"fixed": True},
            "ball": {"mass": MASS, "inertia": [1, 1, 1], "origin": [0, 0, 0.11]},
            "drive": {"mass": 1.0, "inertia": [1, 1, 1], "origin": [0, 0, 0.5]},
        },
        contacts={
            "floor": {
                "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": 0.1}},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": 0.2,
            }
        },
        springs={
            "push": {
                "type": "linear",
                "a": {"body": "drive", "point": [0, 0, 0]},
                "b": {"body": "ball", "point": [0, 0, 0]},
                "stiffness": 1000.0,
                "free_length": 0.39,
            }
        },
        motions={
            "drive": {
                "body": "drive",
                "along": {"point": [0, 0, 0], "direction": [0, 0, 1]},
                "law": {"table": [[0.0, 0.0], [2.0, -0.2]]},
            }
        },
        phases=[{"name": "press", "duration": 2.0, "damping": 20.0}],
        responses={"peak": READ["peak"]},
        simulation={"horizon": 3.0},
    )
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["peak"] == pytest.approx(190.0, rel=0.02)
    assert run.at_impact == ()
