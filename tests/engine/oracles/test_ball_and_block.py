"""One body on a plane: bounces, sticks, slides, rolls; against what mechanics says and Siconos computes."""

from itertools import pairwise

import numpy as np
import pytest

from tests.engine.oracles.reference import at, order, recorded, table
from tests.engine.small import FLOOR, GRAVITY, shipped, small


def bounces(e=0.8, height=0.9, n=6):
    """Return the exact instants of the first impacts of a ball that falls from a height."""
    fall = np.sqrt(2 * height / GRAVITY)
    return fall * (1 + 2 * np.concatenate([[0.0], np.cumsum(e ** np.arange(1, n))]))


def test_bouncing_ball_meets_its_impacts_and_heights_at_first_order():
    """Within 4 steps of each of six impacts (measured 1.6 to 3.0), and 8/s times the step of the heights between them.

    Events are not located: each impact is up to a step late, and those after it inherit that. The gap never closes.
    """
    exact, steps, errors = bounces(), [4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4], []
    for h in steps:
        run = recorded(shipped("bouncing_ball"), h)
        contact, z = run.contacts["floor"], run.responses["height"]
        hits = run.time[contact.impulse[:, 0] > 0][: len(exact)] - h / 2
        errors.append(np.abs(hits - exact).max())
        peaks = [
            z[(run.time > a) & (run.time < b)].max() / (0.9 * 0.8 ** (2 * k))
            for k, (a, b) in enumerate(pairwise(exact), 1)
        ]
        assert errors[-1] < 4 * h
        assert np.abs(np.array(peaks) - 1).max() < 8 * h
        assert contact.gap.min() >= -1e-11
    assert 0.8 < order(steps, errors) < 1.2


def test_bouncing_ball_leaves_the_floor_in_the_plain_scheme():
    """Without projection the ball may sink by a step's fall, and is not held when it rises out of the floor again.

    In the step after an impact the contact can still be active, without friction, slip or load.
    """
    data = shipped("bouncing_ball")
    data["simulation"]["scheme"] = "moreau_jean"
    for h in (4e-3, 1e-3):
        run = recorded(data, h)
        hits = run.time[run.contacts["floor"].impulse[:, 0] > 0]
        assert np.abs(hits[:6] - h / 2 - bounces()).max() < 5 * h
        assert -0.5 * h * np.sqrt(2 * GRAVITY * 0.9) < run.contacts["floor"].gap.min() < 0


def test_bouncing_ball_is_that_of_siconos():
    """At the same step within 4 mm over six bounces (measured 3.1): the sixth impact is two steps earlier here."""
    theirs, run = table("bouncing_ball"), recorded(shipped("bouncing_ball"))
    z = at(run, theirs["t"], run.bodies["ball"].position[:, 2])
    assert np.abs(z - theirs["z"]).max() < 4e-3
    early = theirs["t"] < bounces()[0]
    assert np.abs(z - theirs["z"])[early].max() < 1e-9


def block(degrees):
    """Describe a brick with a contact at each lower corner on the plane z = 0, gravity tilted towards x."""
    length, width, height, mass, angle = 0.2, 0.15, 0.05, 2.0, np.radians(degrees)
    squares = np.array([width**2 + height**2, length**2 + height**2, length**2 + width**2])
    corners = [(x * length / 2, y * width / 2, -height / 2) for x in (-1, 1) for y in (-1, 1)]
    return small(
        gravity=[GRAVITY * np.sin(angle), 0.0, -GRAVITY * np.cos(angle)],
        simulation={"horizon": 0.5, "penetration": 1e-11},
        phases=[{"name": "way", "duration": 0.5}],
        bodies={
            "ground": {"fixed": True},
            "block": {"mass": mass, "inertia": (mass * squares / 12).tolist(), "origin": [0.0, 0.0, height / 2]},
        },
        contacts={
            f"corner_{i}": {
                "a": {"body": "block", "point": list(corner)},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": 0.3,
            }
            for i, corner in enumerate(corners)
        },
    )


@pytest.mark.parametrize("degrees", [10, 16, 30])
def test_block_sticks_or_slides_exactly(degrees):
    """Friction 0.3 holds up to 16.7 degrees, without creep; above it the way is that of g (sin a - mu cos a).

    Measured: 5e-14 m and 2e-11 m/s. Siconos drops the block by 8 um at first, which moves it by up to 5 um.
    """
    run, theirs, angle = recorded(block(degrees)), table(f"incline_{degrees}"), np.radians(degrees)
    acceleration = max(GRAVITY * (np.sin(angle) - 0.3 * np.cos(angle)), 0.0)
    body = run.bodies["block"]
    assert np.abs(body.position[:, 0] - acceleration * run.time**2 / 2).max() < 1e-12
    assert np.abs(body.velocity[:, 0] - acceleration * run.time).max() < 1e-9
    assert np.abs(body.position[:, 2] - 0.025).max() < 1e-11
    assert np.abs(at(run, theirs["t"], body.position[:, 0]) - theirs["x"]).max() < 1e-5


@pytest.mark.parametrize(("case", "v0", "w0"), [("slide", 2.0, 0.0), ("spin", 0.0, 30.0)])
def test_ball_slides_until_it_rolls(case, v0, w0):
    """It rolls with 5/7 v0 + 2/7 r w0 (measured 6e-11 m/s), from within one step of the exact instant on.

    Siconos makes the same steps: speeds agree to 1e-8 m/s, ways to 5e-10 m.
    """
    data = shipped("sphere_roll")
    data["simulation"]["horizon"] = data["phases"][0]["duration"] = 2.0
    data["bodies"]["ball"] |= {"velocity": [v0, 0.0, 0.0], "angular_velocity": [0.0, w0, 0.0]}
    run, theirs = recorded(data), table(f"sphere_{case}")
    body = run.bodies["ball"]
    assert body.velocity[-1, 0] == pytest.approx(5 / 7 * v0 + 2 / 7 * 0.1 * w0, abs=1e-9)
    slip = np.abs(body.velocity[:, 0] - 0.1 * body.angular_velocity[:, 1])
    rolls = abs(v0 - 0.1 * w0) * 2 / 7 / (0.2 * GRAVITY)
    assert 0 <= run.time[np.argmax(slip < 1e-6)] - rolls <= 1e-3
    assert np.abs(at(run, theirs["t"], body.velocity[:, 0]) - theirs["vx"]).max() < 1e-7
    assert np.abs(at(run, theirs["t"], body.position[:, 0]) - theirs["x"]).max() < 1e-8
