"""Runs whose step has no solution end as jammed, with the contacts, the bodies and the motions; others do not."""

from typing import Any

import numpy as np
import pytest

from engine import Run, simulate
from tests.engine.small import GRAVITY, made, shipped, small

pytestmark = pytest.mark.bits

RADIUS = 0.1
SPHERE = {"sphere": {"centre": [0, 0, 0], "radius": RADIUS}}
BALL = {"mass": 1.0, "inertia": [0.004] * 3}
LAW = {"friction": 0.3}
FLOOR = {"body": "floor", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}


def along(body: str, direction: list[float], speed: float) -> dict[str, Any]:
    """Move the origin of a body."""
    return {"body": body, "along": {"point": [0, 0, 0], "direction": direction}, "law": {"speed": speed}}


def driven_ball(**simulation: Any) -> dict[str, Any]:
    """Drive a ball down to a floor 5 cm below it, at 0.5 m/s."""
    return small(
        gravity=[0, 0, -GRAVITY],
        bodies={"floor": {"fixed": True}, "ball": {**BALL, "origin": [0, 0, 0.15]}},
        contacts={"touch": {"a": {"body": "ball", **SPHERE}, "b": FLOOR, **LAW}},
        motions={"push": along("ball", [0, 0, 1], -0.5)},
        phases=[{"name": "down", "duration": 0.5}],
        simulation={"wall_limit": 10.0, **simulation},
    )


def press(friction: float = 0.3, tilt: float = 0.0, **more: Any) -> dict[str, Any]:
    """Lower a plate, tilted about y, on a ball that lies on a floor; the plate cannot turn nor shift."""
    normal = [float(np.sin(tilt)), 0, float(-np.cos(tilt))]
    plate = {"body": "plate", "plane": {"point": [0, 0, 0], "normal": normal}}
    fixed = {f"turn_{k}": {"body": "plate", "about": {"axis": a}, "law": {"speed": 0.0}} for k, a in AXES.items()}
    return small(
        gravity=[0, 0, -GRAVITY],
        bodies={
            "floor": {"fixed": True},
            "ball": {**BALL, "origin": [0, 0, RADIUS]},
            "plate": {"mass": 2.0, "inertia": [0.1] * 3, "origin": [0, 0, 0.3]},
            **more.pop("bodies", {}),
        },
        contacts={
            "below": {"a": {"body": "ball", **SPHERE}, "b": FLOOR, "friction": friction},
            "above": {"a": {"body": "ball", **SPHERE}, "b": plate, "friction": friction},
            **more.pop("contacts", {}),
        },
        motions={
            "lower": along("plate", AXES["z"], -0.2),
            "hold_x": along("plate", AXES["x"], 0.0),
            "hold_y": along("plate", AXES["y"], 0.0),
            **fixed,
        },
        phases=[{"name": "press", "duration": 0.7}],
        **more,
    )


AXES = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}


def judge_jammed(run: Run, *words: str) -> None:
    """Check status and message."""
    assert run.status == "jammed", run.message
    assert run.responses == {}
    for word in ("at step", "t = ", *words):
        assert word in run.message, run.message


@pytest.mark.parametrize("tolerance", [1e-10, 1e-8, 1e-3])
def test_a_ball_driven_through_the_floor(tolerance):
    """At no tolerance does it pass; it took ever shorter steps until the wall limit."""
    run = simulate(made(driven_ball(tolerance=tolerance)))
    judge_jammed(run, "contact touch (ball and floor) from closing while push acts; give push less travel", "spring")
    assert run.certificate.time == pytest.approx(0.1, abs=1e-3)
    assert run.certificate.repeated > 4


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_ball_between_a_floor_and_a_plate_that_is_lowered(friction):
    """Two contacts squeeze: both are named with their bodies, and the one motion that drives them."""
    run = simulate(made(press(friction)))
    judge_jammed(run, "contacts below (ball and floor) and above (ball and plate)", "while lower acts")
    assert run.certificate.time == pytest.approx(0.5, abs=1e-2)  # 10 cm at 0.2 m/s


def test_a_contact_with_a_stiffness_gives_way():
    """A step that is too long for a stiff floor is no jam: no contact that yields is named as what blocks."""
    stiff = press(simulation={"step": 2e-2})
    stiff["contacts"]["below"]["stiffness"] = 1e7
    run = simulate(made(stiff))
    assert (run.status, run.responses) == ("not_converged", {}), run.message
    assert "simulation.step" in run.message


def test_a_wedge_slips_out_or_locks():
    """Under a tilted plate a ball escapes where friction is less than the tangent of half the angle; else it locks."""
    escaped = simulate(made(press(0.1, 0.5)))
    assert escaped.status == "ok", escaped.message
    judge_jammed(simulate(made(press(0.5, 0.3))), "friction locks contacts below", "less friction", "give lower less")


def test_a_squeeze_within_the_friction_tolerance_jams_by_its_penetration():
    """Beside a contact a million times as fast a slow squeeze is small: the projection has no solution either."""
    slow = press(
        0.0,
        simulation={"tolerance": 1e-3},
        bodies={"fast": {**BALL, "origin": [5, 0, RADIUS], "velocity": [1e4, 0, 0]}},
        contacts={"slide": {"a": {"body": "fast", **SPHERE}, "b": FLOOR, "friction": 0.0}},
    )
    slow["motions"]["lower"]["law"] = {"speed": -0.2}
    run = simulate(made(slow))
    judge_jammed(run, "contacts below (ball and floor) and above (ball and plate)", "while lower acts")
    assert run.certificate.max_residual <= 1e-3


def test_two_motions_that_contradict_each_other():
    """One body led by two laws."""
    motions = {"slow": along("ball", AXES["x"], 0.1), "quick": along("ball", AXES["x"], 0.2)}
    bodies = {"floor": {"fixed": True}, "ball": {**BALL}}
    run = simulate(made(small(bodies=bodies, motions=motions, phases=[{"name": "go", "duration": 0.1}])))
    judge_jammed(run, "slow and quick contradict each other")


def test_a_joint_with_play_is_named_by_its_contacts():
    """A link whose eye is dragged straight off its bolt."""
    data = shipped("clearance_pendulum")
    data["gravity"] = [0, 0, 0]
    data["bodies"]["link"]["center_of_mass"] = [0, 0, 0]
    data["motions"] = {"drag": along("link", AXES["x"], 1.0)}
    run = simulate(made(data))
    judge_jammed(run, "contacts J1.ring1 (", "and J1.ring2 (", "link", "while drag acts")


def test_a_tolerance_out_of_reach_is_no_jam():
    """Where the ball may escape a residual below rounding is not reached, and nothing jams."""
    run = simulate(made(press(0.1, 0.5, simulation={"tolerance": 1e-99})))
    assert run.status == "not_converged"
    assert "friction problem: residual" in run.message
