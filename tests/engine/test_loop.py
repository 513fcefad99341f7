"""The time loop goes on where bodies begin to move in the pose at rest, until the horizon."""

import pytest

from engine import load_mechanism
from engine.assembly import assemble
from engine.kernels.time_loop import COMPLETED, OK, PAUSE, SETTLED, STATUS, STOPPED, STOPPED_BY, TIME
from engine.loop import CANCELLED, Cancel, control_of, drive

WINDOW = 0.01  # s
HORIZON = 0.1


def run_that_moves(answer, cancel=None, full_horizon=False):
    """Run the block on the slope, which stands still; return the course, and the times and pauses it was asked at."""
    mechanism = load_mechanism("incline")
    control = control_of(mechanism, full_horizon)._replace(window=WINDOW, horizon=HORIZON, step=1e-3, longest=1e-3)
    asked = []

    def moves(course):
        asked.append((course.reals[TIME], course.reals[PAUSE]))
        return answer(len(asked))

    return drive(assemble(mechanism), control, 60.0, cancel, moves=moves), asked


def test_each_question_waits_twice_as_long():
    """After 10, 20, 40 and 80 ms without motion; at the horizon the window that the mechanism asks for counts."""
    course, asked = run_that_moves(lambda count: True)
    waited = [WINDOW * 2**i for i in range(4)]
    assert [pause for _, pause in asked] == pytest.approx(waited, abs=2e-3)
    assert course.reals[TIME] == pytest.approx(HORIZON)
    assert (course.counts[STATUS], course.counts[SETTLED], course.counts[COMPLETED]) == (OK, 1, 1)


def test_the_first_pose_that_holds_ends_the_run():
    """No body moves at the second question: the run ends there."""
    course, asked = run_that_moves(lambda count: count < 2)
    assert len(asked) == 2
    assert course.reals[TIME] == asked[-1][0] < 0.5 * HORIZON
    assert (course.counts[SETTLED], course.counts[COMPLETED]) == (1, 1)


def test_the_whole_horizon_asks_nothing():
    """A run that does not end at rest has nothing to ask before its horizon."""
    course, asked = run_that_moves(lambda count: True, full_horizon=True)
    assert asked == []
    assert course.reals[TIME] == pytest.approx(HORIZON)


def test_a_run_that_goes_on_can_be_cancelled():
    """The flag holds for the whole run, also after a question."""
    cancel = Cancel()
    course, asked = run_that_moves(lambda count: cancel.set() is None, cancel)
    assert len(asked) == 1
    assert (course.counts[STATUS], course.counts[STOPPED_BY]) == (STOPPED, CANCELLED)
    assert course.counts[SETTLED] == course.counts[COMPLETED] == 0
