"""A mechanism with a body in flight is not at rest, although nothing measures that body."""

from typing import Any

import numpy as np
import pytest

from engine import simulate
from tests.engine.oracles.machines import GROUND, brick, feet, slide
from tests.engine.small import GRAVITY, coordinates, made, small

HALF = [0.05, 0.05, 0.05]


def block_and_stray(mass: float = 1.0, weight: float = GRAVITY, **stray: Any) -> dict[str, Any]:
    """Describe a block at rest on the floor, which is measured, and another body above the floor, which is not."""
    return small(
        gravity=[0, 0, -weight],
        bodies={
            "ground": GROUND,
            "block": brick(1.0, HALF, origin=[0, 0, 0.05]),
            "stray": brick(mass, HALF, origin=[5, 0, 1.0], **stray),
        },
        contacts=feet("block", HALF, "ground", 0.0, 0.3),
        responses=coordinates("block"),
    )


@pytest.mark.parametrize("mass", [1.0, 1e-7])
def test_a_body_that_falls_is_named(mass):
    """However light it is."""
    run = simulate(made(block_and_stray(mass)))
    assert run.status == "not_at_rest"
    assert "stray flies along -z at 9.81 m/s, and no contact, joint or spring holds it" in run.message
    assert "if this motion is meant, give the last phase a duration" in run.message


@pytest.mark.parametrize("axis", "xz")
def test_an_ideal_guide_does_not_hold_it(axis):
    """Along a guide it falls, or goes on at the speed that it has."""
    data = block_and_stray(velocity=[1.0, 0, 0] if axis == "x" else [0, 0, 0])
    data["joints"] = {"guide": slide("stray", [5, 0, 1.0], axis)}
    run = simulate(made(data))
    assert run.status == "not_at_rest"
    assert f"stray flies along {'+x' if axis == 'x' else '-z'}, the axis of guide" in run.message


def test_without_a_load_it_goes_on_for_ever():
    """Away from all others; towards a wall it is waited for."""
    data = block_and_stray(weight=0.0, velocity=[1.0, 0, 0])
    wall = {"point": [0, 0, 0], "normal": [1.0, 0, 0]}
    data["contacts"]["wall"] = {
        "a": {"body": "stray", "point": [0, 0, 0]},
        "b": {"body": "ground", "plane": wall},
        "friction": 0.0,
    }
    away = simulate(made(data))
    assert away.status == "not_at_rest"
    assert "stray flies along +x at 1 m/s" in away.message
    data["bodies"]["stray"]["velocity"] = [-1.0, 0, 0]
    assert simulate(made(data)).status == "ok"


def test_what_lands_later_is_waited_for():
    """A fall of 0.95 m takes 0.44 s, and the window of rest is 0.05 s."""
    data = block_and_stray()
    data["contacts"] |= feet("stray", HALF, "ground", 0.0, 0.3)
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert np.sqrt(2 * 0.95 / GRAVITY) < run.certificate.time < 1.0


def test_where_it_is_meant_a_duration_says_so():
    """The same fall in a phase of a given duration."""
    data = block_and_stray() | {"phases": [{"name": "drop", "duration": 0.5}]}
    assert simulate(made(data)).status == "ok"


def test_what_a_bearing_or_a_spring_holds_may_move_on():
    """A pendulum and a mass on a spring, neither of them damped nor measured."""
    data = block_and_stray()
    pin = {"point": [-0.1, 0, 0], "axis": [0, 1, 0]}
    data["joints"] = {
        "pin": {
            "type": "revolute",
            "bearing": {**pin, "body": "stray"},
            "journal": {**pin, "body": "ground", "point": [4.9, 0, 1.0]},
        }
    }
    assert simulate(made(data)).status == "ok"
    data = block_and_stray()
    data["springs"] = {
        "spring": {
            "type": "linear",
            "stiffness": 100.0,
            "free_length": 1.0,
            "a": {"body": "ground", "point": [5, 0, 2.0]},
            "b": {"body": "stray", "point": [0, 0, 0]},
        }
    }
    assert simulate(made(data)).status == "ok"
