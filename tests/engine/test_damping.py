"""Damping in proportion to the masses, `[[phases]] damping`, against closed forms."""

import numpy as np
import pytest

from engine import MechanismError, simulate
from engine.assembly import assemble
from tests.engine.histories import recorded
from tests.engine.small import GRAVITY, block_on_floor, coordinates, made, small

TIME = 0.5  # s


def damped(data, rate, step=1e-2):
    """Run it for half a second with one damping rate [1/s]; return its motion."""
    data["simulation"] |= {"step": step, "horizon": TIME}
    data["phases"] = [{"name": "settle", "duration": TIME, "damping": rate}]
    mechanism = made(data)
    return recorded(assemble(mechanism), mechanism)


def flying(**body):
    """Describe one body in free flight."""
    body = {"mass": 2.0, "inertia": [0.2, 0.2, 0.2]} | body
    return small(bodies={"ground": {"fixed": True}, "ball": body}, responses=coordinates("ball"))


@pytest.mark.parametrize("rate", [0.3, 4.0, 1e4])
def test_a_free_body_slows_down_exponentially(rate):
    """Velocity and spin fall by exp(-rate t), to rounding, for steps far longer than 1/rate too."""
    run = damped(flying(velocity=[1.0, -2.0, 0.5], angular_velocity=[3.0, 1.0, -2.0]), rate)
    expected = np.exp(-rate * TIME) * np.array([1.0, -2.0, 0.5, 3.0, 1.0, -2.0])
    assert run.v[-1, 0] == pytest.approx(expected, rel=1e-11, abs=1e-100)


def test_its_way_is_of_second_order():
    """Its way is v (1 - exp(-c t))/c: half the step leaves a quarter of the error."""
    way = (1 - np.exp(-4.0 * TIME)) / 4.0
    errors = [damped(flying(velocity=[1.0, 0, 0]), 4.0, step).x[-1, 0, 0] - way for step in (1e-2, 5e-3)]
    assert 0 < errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.01)


@pytest.mark.parametrize("rate", [20.0, 1e5])
def test_a_falling_body_reaches_its_last_speed(rate):
    """Weight over damping, g / rate: whatever the rate, no faster and no slower."""
    data = flying()
    data["gravity"] = [0, 0, -GRAVITY]
    run = damped(data, rate)
    assert run.v[-1, 0, 2] == pytest.approx(-GRAVITY / rate, rel=1e-4)
    assert (run.v[:, 0, 2] >= -GRAVITY / rate * (1 + 1e-12)).all()


def test_what_lies_still_is_pressed_by_its_weight():
    """Damping takes no part in a balance: the forces under a block at rest carry it."""
    run = damped(block_on_floor(origin=[0, 0, 0.1]), 200.0)
    assert run.r[-1, :, 0].sum() / run.step[-1] == pytest.approx(2.0 * GRAVITY, rel=1e-6)


def test_a_swing_without_friction_comes_to_rest_where_it_belongs():
    """A mass on a spring: undamped it never rests, damped it ends at its natural length."""
    data = flying(velocity=[0.3, 0, 0])
    ends = {"a": {"body": "ground", "point": [-1, 0, 0]}, "b": {"body": "ball", "point": [0, 0, 0]}}
    data["springs"] = {"s": {"type": "linear", **ends, "stiffness": 800.0, "free_length": 1.0}}
    data["simulation"]["horizon"] = 2.0
    assert simulate(made(data)).status == "not_at_rest"
    data["phases"] = [{"name": "settle", "damping": 20.0}]
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.certificate.time < 1.5
    assert run.responses["x"] == pytest.approx(0, abs=1e-6)


def test_a_negative_rate_is_refused():
    """It would drive the mechanism."""
    with pytest.raises(MechanismError, match=r"damping"):
        made(flying() | {"phases": [{"name": "settle", "damping": -1.0}]})
