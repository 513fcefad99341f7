"""Friction that depends on the sliding speed (Stribeck's curve): closed forms, keys, what it leaves alone."""

from typing import Any

import numpy as np
import pytest

from engine import simulate
from engine.assembly import assemble
from engine.errors import MechanismError
from engine.mechanism import set_values, settable_keys
from tests.each import each
from tests.engine.small import GRAVITY, block_on_floor, made

FRICTION, SLOPE = 0.4, float(np.arctan(0.3))
FALLING, RISING = [[0.0, 1.0], [1.0, 0.5]], [[0.0, 0.5], [1.0, 1.0]]  # factors of 0.4 from 0 to 1 m/s


def brick(table: Any, speed: float = 0.0, duration: float | None = None, slope: float = SLOPE) -> dict[str, Any]:
    """Describe a brick that slides down a slope."""
    data = block_on_floor(origin=[0, 0, 0.1], velocity=[speed, 0, 0], friction=FRICTION)
    data["gravity"] = [GRAVITY * np.sin(slope), 0, -GRAVITY * np.cos(slope)]
    for contact in data["contacts"].values():
        contact["friction_over_speed"] = {"table": table}
    if duration:
        data["phases"] = [{"name": "run", "duration": duration}]
    data["responses"]["speed"] = {**data["responses"]["x"], "type": "velocity"}
    return data


@each(("table", "sign"), [(FALLING, 1.0), (RISING, -1.0)])
@each("speed", [0.45, 0.55])
def test_a_speed_at_which_friction_holds_the_slope_is_left_or_reached(table, sign, speed):
    """At 0.5 m/s friction is 0.3, the slope's; a difference grows or falls with 1 / g cos 0.2 s/m."""
    run = simulate(made(brick(table, speed, 0.3)))
    assert run.status == "ok", run.message
    rate = sign * GRAVITY * np.cos(SLOPE) * 0.2
    assert run.responses["speed"] == pytest.approx(0.5 + (speed - 0.5) * np.exp(rate * 0.3), rel=2e-3)
    assert run.certificate.created_energy < 1e-8


def test_what_sticks_holds_with_the_first_factor():
    """Up to 0.4 a brick at rest stays, with forces at rest; pushed to 0.6 m/s, it gains speed on the same slope."""
    rests = simulate(made(brick(FALLING)))
    assert rests.status == "ok", rests.message
    assert rests.responses["x"] == pytest.approx(0.0, abs=1e-9)
    slides = simulate(made(brick(FALLING, 0.6, 0.2)))
    assert slides.responses["speed"] > 0.61
    steep = simulate(made(brick(FALLING, 0.0, 0.2, slope=float(np.arctan(0.41)))))
    assert steep.responses["x"] > 1e-3


def test_a_brick_that_slows_down_stops_where_the_integral_says():
    """On a level floor v' = -g (0.4 - 0.2 v): it stops after (v + 2 ln(1 - v/2)) / -0.2 g."""
    run = simulate(made(brick(FALLING, 0.8, slope=0.0)))
    assert run.status == "ok", run.message
    assert run.responses["x"] == pytest.approx(-(0.8 + 2 * np.log(1 - 0.4)) / (0.2 * GRAVITY), rel=2e-3)


def test_one_is_no_factor():
    """A table of 1 gives the motion of a file without it, and a file without it has no array of its own."""
    plain = brick([[0, 1], [1, 1]], 0.3, 0.1)
    first = simulate(made(plain)).responses
    for contact in plain["contacts"].values():
        del contact["friction_over_speed"]
    assert simulate(made(plain)).responses == first
    assert not assemble(made(plain)).model.laws.table.size


def test_materials_have_it_and_every_number_has_a_key():
    """That of the material, for joints with play too, unless there is a friction or static_friction of its own."""
    data = brick(FALLING)
    data["materials"] = {"oiled": {"friction": 0.2, "friction_over_speed": {"table": [[0, 2], [0.1, 1]]}}}
    names = list(data["contacts"])
    for name in names[:2]:
        data["contacts"][name] = {key: data["contacts"][name][key] for key in ("a", "b")} | {"material": "oiled"}
    data["contacts"][names[1]]["static_friction"] = 0.3
    mechanism = made(data)
    assert [round(mechanism.static_friction(mechanism.contacts[name]), 9) for name in names[:3]] == [0.4, 0.3, 0.4]
    keys = [key for key in settable_keys(mechanism) if "friction_over_speed" in key]
    assert any(key.startswith("materials.oiled.") for key in keys)
    assert any(key.startswith(f"contacts.{names[2]}.") for key in keys)
    assert set_values(mechanism, {keys[0]: 0.0})


@each(
    ("change", "named"),
    [
        ({"friction_over_speed": {"table": [[0, 1], [1, -0.1]]}}, r"friction_over_speed\.table"),
        ({"friction_over_speed": {"table": [[-1, 1], [1, 1]]}}, r"friction_over_speed\.table"),
        ({"friction_over_speed": {"table": [[0, 1]]}}, r"friction_over_speed\.table"),
        ({"static_friction": 0.5}, r"contacts\.corner_0\.static_friction"),
    ],
)
def test_what_cannot_be_is_refused(change, named):
    data = brick(FALLING)
    data["contacts"]["corner_0"] |= change
    with pytest.raises(MechanismError, match=named):
        made(data)
