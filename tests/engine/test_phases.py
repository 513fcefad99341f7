"""Phases that end at an event, motions that begin and end with phases, and what is read then, against closed forms."""

from typing import Any

import numpy as np
import pytest

from engine import simulate
from engine.mechanism import Mechanism
from tests.engine.small import GRAVITY, block_on_floor, coordinates, made, small

STEP = 1e-3
SPEED = 3.0
X = {"along": {"point": [0, 0, 0], "direction": [1, 0, 0]}}
VX = {"type": "velocity", "to": {"body": "ball", "point": [0, 0, 0]}, "direction": {"vector": [1, 0, 0]}}


def ball(phases: list[dict[str, Any]], **tables: Any) -> Mechanism:
    """Make a free ball with a speed along x, in these phases."""
    body = {"mass": 2.0, "inertia": [1, 1, 1], "velocity": [SPEED, 0, 0]}
    responses = {**coordinates("ball"), "t": {"type": "time"}, "v": VX} | tables.pop("responses", {})
    bodies = {"ground": {"fixed": True}, "ball": body}
    return made(small(phases=phases, bodies=bodies, responses=responses, simulation={"step": STEP}, **tables))


def test_a_phase_ends_with_the_first_step_beyond_the_limit():
    """The ball passes x = 1 at t = 1/3; from then on it is decelerated for 0.1 s."""
    until = {"response": "x", "above": 1.0}
    run = simulate(
        ball(
            [{"name": "fly", "until": until}, {"name": "brake", "duration": 0.1}],
            forces={"brake": {"body": "ball", "force": [-6.0, 0, 0], "phases": ["brake"]}},
        )
    )
    assert run.status == "ok", run.message
    assert run.responses["t"] == pytest.approx(1 / 3 + 0.1, abs=STEP)
    assert run.responses["v"] == pytest.approx(SPEED - 0.3, abs=1e-12)


def test_an_event_that_does_not_come_is_named():
    """The ball never is at x = 9 within the horizon of 1 s."""
    until = {"response": "x", "above": 9.0}
    run = simulate(ball([{"name": "fly", "until": until}, {"name": "after", "duration": 0.1}]))
    assert run.status == "not_at_rest"
    assert "phase fly" in run.message
    assert "x was never above 9 m" in run.message


def test_an_event_of_a_phase_with_a_duration_only_shortens_it():
    """Not reached within 0.1 s: the phase is over all the same."""
    until = {"response": "x", "above": 9.0}
    run = simulate(ball([{"name": "fly", "duration": 0.1, "until": until}, {"name": "after", "duration": 0.1}]))
    assert run.status == "ok", run.message
    assert run.responses["t"] == pytest.approx(0.2, abs=STEP)


@pytest.mark.parametrize("h", [STEP, 0.7 * STEP])
def test_a_motion_of_a_phase_starts_where_the_body_is_and_lets_go_of_it(h):
    """0.2 s free, 0.3 s led from there at -1 m/s, then free again at that speed."""
    push = {"body": "ball", **X, "law": {"speed": -1.0}, "phases": ["push"]}
    phases = [{"name": n, "duration": d} for n, d in (("free", 0.2), ("push", 0.3), ("after", 0.1))]
    run = simulate(ball(phases, motions={"push": push}), step=h)
    assert run.status == "ok", run.message
    assert run.responses["v"] == pytest.approx(-1.0, abs=1e-12)
    assert run.responses["x"] == pytest.approx(SPEED * 0.2 - 0.4, abs=1e-12)
    assert run.certificate.max_violation < 1e-12


def test_a_turning_motion_of_a_phase_starts_where_the_body_is():
    """The spinning ball is turned on by a smooth table of 2 rad, and stays as it was left."""
    body = {"mass": 2.0, "inertia": [1, 2, 3], "angular_velocity": [0, 0, 5.0]}
    turn = {
        "body": "ball",
        "about": {"axis": [0, 0, 1]},
        "law": {"table": [[0, 0], [0.2, 2.0]], "interpolation": "smooth"},
        "phases": ["turn", "rest"],
    }
    angle = {"type": "angle", "body": "ball", "axis": [0, 0, 1]}
    phases = [{"name": "spin", "duration": 0.1}, {"name": "turn", "duration": 0.3}, {"name": "rest", "duration": 0.1}]
    mechanism = small(bodies={"ball": body}, phases=phases, motions={"turn": turn}, responses={"angle": angle})
    run = simulate(made(mechanism))
    assert run.status == "ok", run.message
    assert run.responses["angle"] == pytest.approx(0.5 + 2.0, abs=1e-11)


def test_the_law_of_a_motion_or_force_may_count_from_a_later_phase():
    """BilateralState at the start until the second phase, then led at 2 m/s; the force grows from there, too."""
    push = {"body": "ball", **X, "law": {"speed": 2.0}, "since": "push"}
    lift = {"body": "ball", "force": [0, 0, 1], "law": {"table": [[0, 0], [1, 12.0]]}, "since": "push"}
    phases = [{"name": "hold", "duration": 0.25}, {"name": "push", "duration": 0.5}]
    run = simulate(ball(phases, motions={"push": push}, forces={"lift": lift}))
    assert run.status == "ok", run.message
    assert run.responses["x"] == pytest.approx(1.0, abs=1e-12)
    assert run.responses["z"] == pytest.approx(12.0 / 2.0 * 0.5**3 / 6, rel=1e-5)  # z'' = 6 t


def test_differences_and_conditions_follow_from_what_is_reported():
    """Height at two events of a fall, their difference, and whether it has fallen far."""
    z = coordinates("ball")["z"]
    run = simulate(
        ball(
            [{"name": "fall", "duration": 0.4}],
            gravity=[0, 0, -GRAVITY],
            responses={
                "first": {**z, "at": {"response": "t", "above": 0.1}},
                "second": {**z, "at": {"response": "t", "above": 0.3}},
                "way": {"type": "difference", "of": ["first", "second"]},
                "far": {"type": "condition", "condition": "way_z < -0.5"},
                "near": {"type": "condition", "condition": "way_z > -0.5"},
                "way_z": z,
            },
        )
    )
    assert run.status == "ok", run.message
    assert run.responses["way"] == pytest.approx(GRAVITY / 2 * (0.09 - 0.01), abs=1e-5)
    assert (run.responses["far"], run.responses["near"]) == (1.0, 0.0)
    assert (run.units["way"], run.units["far"]) == ("m", "1")


def test_something_is_read_where_another_response_peaks():
    """A thrown ball is at its top after v/g, where it has flown v/g far."""
    speed = 2.0
    body = {"mass": 1.0, "inertia": [1, 1, 1], "velocity": [SPEED, 0, speed]}
    xyz = coordinates("ball")
    mechanism = small(
        gravity=[0, 0, -GRAVITY],
        phases=[{"name": "fly", "duration": 0.5}],
        bodies={"ground": {"fixed": True}, "ball": body},
        responses=xyz | {"top": {**xyz["x"], "at": {"response": "z", "peak": "maximum"}}},
    )
    assert simulate(made(mechanism)).responses["top"] == pytest.approx(SPEED * speed / GRAVITY, abs=SPEED * STEP)


def test_least_and_largest_force_at_rest_are_responses():
    """A heavy plank on three supports in a row: each may carry nothing, the outer ones half, the middle one all."""
    supports = {"left": -1.0, "middle": 0.0, "right": 1.0}
    contacts = {
        name: {
            "a": {"body": "plank", "point": [x, 0, 0]},
            "b": {"body": "ground", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}},
            "friction": 0.0,
        }
        for name, x in supports.items()
    }
    hold = {
        "y": {"body": "plank", "along": {"direction": [0, 1, 0]}, "law": {"speed": 0.0}},
        "roll": {"body": "plank", "about": {"axis": [1, 0, 0]}, "law": {"speed": 0.0}},
        "yaw": {"body": "plank", "about": {"axis": [0, 0, 1]}, "law": {"speed": 0.0}},
    }
    force = {"type": "contact_force"}
    responses = {
        f"{name}_{bound}": {**force, "contact": name, "bound": bound}
        for name in supports
        for bound in ("least", "largest")
    } | {name: {**force, "contact": name} for name in supports}
    mechanism = small(
        gravity=[0, 0, -GRAVITY],
        bodies={"ground": {"fixed": True}, "plank": {"mass": 1.0, "inertia": [1, 1, 1]}},
        contacts=contacts,
        motions=hold,
        responses=responses,
    )
    run = simulate(made(mechanism))
    assert run.status == "ok", run.message
    for name, largest in (("left", 0.5), ("middle", 1.0), ("right", 0.5)):
        assert run.responses[f"{name}_least"] == pytest.approx(0.0, abs=1e-9)
        assert run.responses[f"{name}_largest"] == pytest.approx(largest * GRAVITY, rel=1e-6)
        assert run.responses[name] == pytest.approx(GRAVITY / 3, rel=1e-6)
    assert not np.isnan(list(run.responses.values())).any()


def pushed_block(phases: list[dict[str, Any]], read: dict[str, str], push: float) -> Mechanism:
    """Make a block dropped on a floor whose friction holds it against a push, with the forces of four corners read."""
    data = block_on_floor(friction=0.4, origin=[0, 0, 0.1001])
    data["forces"] = {"push": {"body": "block", "point": [0.3, 0.05, 0.03], "force": [push, 0, 0]}}
    data["phases"] = phases
    corners = {"type": "contact_force", **read}
    data["responses"] |= {f"corner_{i}": {**corners, "contact": f"corner_{i}"} for i in (0, 2, 4, 6)}
    data["responses"]["most"] = {**corners, "contact": "corner_0", "bound": "largest"}
    return made(data)


@pytest.mark.parametrize("settle", [{}, {"duration": 0.5}])
def test_a_force_at_the_end_of_a_phase_at_rest_is_that_of_a_run_which_ends_there(settle):
    """The same forces and ranges, linear in the push by the balance of moments, whatever the phase ends by."""
    first = {"name": "settle", **settle}
    loads, found = [4.0, 4.5, 5.0, 5.5, 6.0], []
    for load in loads:
        ended = simulate(pushed_block([first], {}, load), indeterminacy=True)
        phases = [first, {"name": "after", "duration": 0.05}]
        earlier = simulate(pushed_block(phases, {"to_phase": "settle"}, load), indeterminacy=True)
        assert earlier.status == ended.status == "ok", earlier.message
        for corner in ("corner_0", "corner_2", "corner_4", "corner_6", "most"):
            assert earlier.measured[corner] == pytest.approx(ended.measured[corner], abs=1e-6)
        assert earlier.ranges.keys() == ended.ranges.keys()
        assert len(ended.ranges) == 4
        found.append([earlier.measured[f"corner_{i}"] for i in (0, 2, 4, 6)])
    lifted = np.array(found)[:, :2].sum(axis=1)  # both corners behind, from which the push takes its moment
    np.testing.assert_allclose(lifted, 2.0 * GRAVITY / 2 - 0.13 * np.array(loads) / 0.6, atol=1e-5)


def test_an_event_at_the_beginning_of_a_phase_reads_the_forces_at_rest():
    """A force that has passed its limit before the phase begins is read at rest there, not in the step before."""
    phases = [{"name": "settle"}, {"name": "after", "duration": 0.05}]
    at = {"at": {"response": "t", "above": 0.0}, "from_phase": "after"}
    data = pushed_block(phases, {"to_phase": "settle"}, 5.0).model_dump(by_alias=True, exclude_none=True)
    data["responses"] |= {"t": {"type": "time"}, "early": {"type": "contact_force", "contact": "corner_0", **at}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.measured["early"] == pytest.approx(run.measured["corner_0"], abs=1e-9)
