"""A phase that begins at rest stays at rest where friction holds as before, and says where motion is as good."""

from typing import Any

import pytest

from engine import execution, load_mechanism, simulate
from engine.run import Run
from tests.engine.small import GRAVITY, block_on_floor, coordinates, made, small

ARM, APART = 0.02, 0.01  # m from the post to the centre of mass; between the rings
THRESHOLD = APART / (2 * ARM)  # of friction: the rings press with m g ARM / APART each, and carry m g together
HOLD = {
    "body": "bracket",
    "along": {"point": [0, 0, 0], "direction": [0, 0, 1]},
    "law": {"table": [[0.0, 0.0], [1e-3, 0.0]]},
    "phases": ["hold"],
}


def bracket(friction: float, **tables: Any) -> Run:
    """Run a bracket on a post, first held by a motion until its rings press, then released."""
    data = small(
        gravity=[0, 0, -GRAVITY],
        phases=[{"name": "hold", "duration": 0.1, "damping": 50.0}, {"name": "free"}],
        motions={"hold": HOLD},
        bodies={
            "ground": {"fixed": True},
            "bracket": {"mass": 0.05, "inertia": [3e-6, 3e-6, 5e-6], "center_of_mass": [ARM, 0, 0]},
        },
        joints={
            "J": {
                "type": "clearance_cylindrical",
                "bearing": {"body": "bracket", "point": [0, 0, 0], "axis": [0, 0, 1]},
                "journal": {"body": "ground", "point": [0, 0, 0], "axis": [0, 0, 1], "radius": 0.005},
                "rings": [-APART / 2, APART / 2],
                "radial_clearance": 5e-5,
                "friction": friction,
            }
        },
        responses=coordinates("bracket") | tables.pop("responses", {}),
        simulation={"step": 1e-4, "horizon": 0.3, "penetration": 1e-10, "rest": {"window": 2e-3, "drift": 1e-9}},
        **tables,
    )
    return simulate(made(data))


@pytest.mark.parametrize("factor", [1.01, 1.04, 1.12, 1.2, 1.4, 2.0, 4.0])
def test_a_bracket_locks_itself_above_the_threshold_and_says_that_it_could_fall(factor):
    """Held with every friction above ARM and ring distance; free fall solves the equations as well."""
    run = bracket(factor * THRESHOLD)
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(0.0, abs=1e-9)
    assert run.ambiguous
    assert len(run.remarks) == 1


@pytest.mark.parametrize("factor", [0.5, 0.9, 0.98])
def test_a_bracket_falls_below_the_threshold(factor):
    """No forces hold it: it is not at rest, and there is no choice."""
    run = bracket(factor * THRESHOLD)
    assert run.status == "not_at_rest"
    assert run.measured["z"] < -0.05
    assert not run.ambiguous


def test_the_forces_that_hold_a_locked_bracket_balance_it():
    """Moment and weight: N1 = N2 where friction is the same at both rings, and the resultant carries the weight."""
    forces = {f"N{i}": {"type": "contact_force", "contact": f"J.ring{i}"} for i in (1, 2)}
    up = {"type": "joint_force", "joint": "J", "direction": {"vector": [0, 0, 1]}}
    run = bracket(2 * THRESHOLD, responses=forces | {"up": up})
    assert run.status == "ok", run.message
    assert run.ambiguous
    assert run.responses["up"] == pytest.approx(-0.05 * GRAVITY, rel=1e-6)
    assert run.responses["N1"] == pytest.approx(run.responses["N2"], rel=1e-3)


@pytest.mark.parametrize(("factor", "may_hold"), [(0.5, False), (0.9, False), (0.98, False), (1.04, True)])
def test_forces_that_hold_are_sought_only_where_there_may_be_some(monkeypatch, factor, may_hold):
    """To find that no forces balance takes much longer than the convex problem that proves it."""
    searches, search = [], execution.balancing_forces
    monkeypatch.setattr(execution, "balancing_forces", lambda *of, **how: searches.append(1) or search(*of, **how))
    bracket(factor * THRESHOLD)
    assert bool(searches) == may_hold


def test_in_a_breaker_no_search_is_needed(monkeypatch):
    """No forces hold the C-60's latch when it is let go."""
    monkeypatch.setattr(execution, "balancing_forces", lambda *given, **named: pytest.fail("a search"))
    for clearance in (0.03, 0.07, 0.11):
        run = simulate(load_mechanism("c60"), {"J2": clearance})
        assert run.status == "ok", run.message
        assert not run.ambiguous


def test_a_block_between_walls_that_do_not_press_falls():
    """Friction could wedge it, but nothing pressed before it was let go."""
    data = block_on_floor(friction=0.8, origin=[0, 0, 1.0])
    for name in data["contacts"]:
        data["contacts"][name]["b"]["plane"] = {"point": [-0.3, 0, 0], "normal": [1, 0, 0]}
        if data["contacts"][name]["a"]["point"][0] > 0:
            data["contacts"][name]["b"]["plane"] = {"point": [0.3, 0, 0], "normal": [-1, 0, 0]}
    data["motions"] = {"hold": HOLD | {"body": "block"}}
    data["phases"] = [{"name": "hold", "duration": 0.1}, {"name": "free", "duration": 0.1}]
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(1.0 - GRAVITY * 0.1**2 / 2, abs=1e-4)


def test_what_can_only_rest_is_no_choice():
    """A block on a floor, let go of by a force that held it against nothing."""
    data = block_on_floor(origin=[0, 0, 0.1])
    data["forces"] = {"push": {"body": "block", "force": [1.0, 0, -5.0], "phases": ["push"]}}
    data["phases"] = [{"name": "push"}, {"name": "free"}]
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert not run.ambiguous
