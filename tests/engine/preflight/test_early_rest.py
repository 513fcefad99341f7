"""Windows of rest that are shorter than the time in which the loads close a play."""

import pytest

from engine import simulate
from tests.engine.preflight.examples import lever, warned
from tests.engine.small import made, shipped


def pendulum(window):
    """Take the shipped pendulum, with this window of rest; g closes its play of 0.5 mm in 10.4 ms."""
    data = shipped("clearance_pendulum")
    data["simulation"]["rest"]["window"] = window
    return data


def test_a_run_that_would_end_at_once():
    """Within 1 ms nothing moves by a drift of 1e-5 m: the run ends where it started, and the caution said so."""
    data = pendulum(1e-3)
    data["simulation"]["rest"]["drift"] = 1e-5
    (text,) = warned(data)
    assert text.startswith("simulation.rest.window = 0.001 s: the loads take 0.0104 s to close the play joints.J1.rad")
    assert "nothing that is measured moves at first: the run would end before" in text
    run = simulate(made(data))
    assert run.status == "ok"
    assert run.responses["drop"] == pytest.approx(0.0, abs=2e-5)  # at rest it is 5e-4


def test_a_window_far_shorter_than_a_play_takes():
    """What is measured does move at first; bodies in flight count for nothing later."""
    (text,) = warned(pendulum(1e-3))
    assert "a body in flight that nothing measures does not count as moving; customary: more than 0.01 s" in text


@pytest.mark.parametrize("window", [5e-3, 0.02, 0.5])
def test_a_window_long_enough(window):
    """Of the size of the play's time, or longer."""
    assert warned(pendulum(window)) == []


def test_the_gap_of_a_contact_counts_where_the_run_would_end_at_once():
    """The docs' lever needs 0.75 ms to its stop."""
    data = lever()
    data["simulation"]["rest"] = {"window": 0.01, "drift": 1e-3}
    (text,) = warned(data)
    assert "to close the gap of contacts.stop" in text
