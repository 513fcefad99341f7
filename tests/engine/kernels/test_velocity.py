"""Impulses of one step: an impact that runs through a row of bodies, beside a contact that it does not concern."""

from typing import Any

import numpy as np

from tests.engine.histories import history
from tests.engine.small import made, small

BODIES, GAP, STEP, SPEED, SLOW, ROW = 30, 1e-6, 1e-3, 1.0, 0.1, 1.0  # SI


def row_of_bodies() -> dict[str, Any]:
    """Describe bodies of mass 1 in a row along x, each a gap before the next, the first one fast; and a falling ball.

    The ball, which would bounce, comes near its plane in the first step, and does not reach it.
    """
    bodies = {"ground": {"fixed": True}, "ball": {"mass": 1.0, "inertia": [1.0] * 3, "velocity": [0.0, 0.0, -SLOW]}}
    contacts = {
        "bounce": {
            "a": {"body": "ball", "point": [0.0, 0.0, 0.0]},
            "b": {"body": "ground", "plane": {"point": [0.0, 0.0, -2 * STEP * SLOW], "normal": [0.0, 0.0, 1.0]}},
            "friction": 0.0,
            "restitution": 0.5,
        }
    }
    for k in range(BODIES):
        speed = SPEED if k == 0 else 0.0
        bodies[f"B{k}"] = {"mass": 1.0, "inertia": [1.0] * 3, "origin": [k, ROW, 0.0], "velocity": [speed, 0.0, 0.0]}
    for k in range(BODIES - 1):
        contacts[f"C{k}"] = {
            "a": {"body": f"B{k}", "point": [1.0 - GAP, 0.0, 0.0]},
            "b": {"body": f"B{k + 1}", "plane": {"point": [0.0, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0]}},
            "friction": 0.1,
        }
    return small(bodies=bodies, contacts=contacts, simulation={"step": STEP, "horizon": STEP, "theta": 1.0})


def test_an_impact_runs_through_a_row_in_one_step():
    """All gaps close at the end of the step, v_k - v_k+1 = g/h, and the momentum is that of the first body before."""
    run = history(made(row_of_bodies()))
    row = run.x[0, :, 1] == ROW
    along = np.argsort(run.x[0, row, 0])
    exact = SPEED / BODIES + GAP / STEP * ((BODIES - 1) / 2 - np.arange(BODIES))
    np.testing.assert_allclose(run.v[-1, row, 0][along], exact, rtol=0, atol=1e-7)
    pressed = [name.startswith("C") for name in run.assembly.contact_names]
    assert (run.r[-1, pressed, 0] > 0).all()


def test_growth_leaves_a_contact_with_restitution_alone_that_does_not_close():
    """The law of Newton holds for contacts that close: the ball beside the row falls on as if there were no row."""
    run = history(made(row_of_bodies()))
    ball = run.x[0, :, 1] != ROW
    np.testing.assert_array_equal(run.v[-1, ball, :3], [[0.0, 0.0, -SLOW]])
    assert run.r[-1, run.assembly.contact_names.index("bounce"), 0] == 0.0


def test_the_slip_speed_is_the_same_in_every_direction():
    """Points that slide over a plane without friction, however its tangents lie."""
    way = np.radians([0.0, 53.0, 140.0, 260.0])
    bodies: dict[str, Any] = {"ground": {"fixed": True}}
    contacts = {}
    for k, angle in enumerate(way):
        velocity = [SPEED * np.cos(angle), SPEED * np.sin(angle), 0.0]
        bodies[f"B{k}"] = {"mass": 1.0, "inertia": [1.0] * 3, "origin": [5.0 * k, 0.0, 0.0], "velocity": velocity}
        contacts[f"C{k}"] = {
            "a": {"body": f"B{k}", "point": [0.0, 0.0, 0.0]},
            "b": {"body": "ground", "plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}},
            "friction": 0.0,
        }
    clock = {"step": STEP, "horizon": 5 * STEP, "theta": 1.0}
    run = history(made(small(bodies=bodies, contacts=contacts, simulation=clock, gravity=[0.0, 0.0, -9.81])))
    assert (run.r[-1, :, 0] > 0).all()
    np.testing.assert_allclose(run.assembly.state.slip, SPEED, rtol=1e-12)
