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
    """Within 1 ms nothing moves by a drift of 1e-5 m; here a body is in flight, and the run goes on until it hangs."""
    data = pendulum(1e-3)
    data["simulation"]["rest"]["drift"] = 1e-5
    (text,) = warned(data)
    assert text.startswith("simulation.rest.window = 0.001 s: the loads take 0.0104 s to close the play joints.J1.rad")
    assert "nothing that is measured moves at first: the run could end before" in text
    run = simulate(made(data))
    assert run.status == "ok"
    assert run.responses["drop"] == pytest.approx(5e-4, abs=1e-5)


def test_a_window_far_shorter_than_a_play_takes():
    """What is measured does move at first; later bodies that are not measured count only in flight."""
    (text,) = warned(pendulum(1e-3))
    assert "a body that nothing measures counts as moving only in flight; customary: more than 0.01 s" in text


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
