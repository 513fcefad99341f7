"""The story of the measured levers, with few runs: what is found holds what is true, before and after calibration."""

import pytest

from studies.levers import ASSUMED_FRICTION, GAUGE, HEAD, TRUE_FRICTION, Sizes, lines, tell

pytestmark = [pytest.mark.slow, pytest.mark.processes]


@pytest.fixture(scope="module")
def story(tmp_path_factory):
    """Tell the story with fewer runs, once for all tests."""
    return tell(tmp_path_factory.mktemp("levers"), Sizes(rows=400, fresh=400))


def test_intervals_hold_what_is_true(story):
    """The gauge's sigma and the friction lie in their intervals; the friction that was assumed does not."""
    low, high = story.gauge.of("gauge R&R").std_interval
    assert low < GAUGE < high
    low, high = story.calibration.constants[0].interval
    assert ASSUMED_FRICTION < low < TRUE_FRICTION < high


def test_the_mean_is_missed_before_calibration_and_met_after_it(story):
    """The interval of the difference of the means leaves out 0, then holds it; the verdict says so."""
    before, after = story.before.predictions[0], story.after.predictions[0]
    assert before.comparison.mean_interval[1] < 0
    assert "the mean is below the predicted one" in before.verdict
    assert after.comparison.mean_interval[0] < 0 < after.comparison.mean_interval[1]
    assert "the mean is" not in after.verdict
    assert after.mean_within < before.mean_within / 3


def test_the_looser_tolerance_is_confirmed(story):
    """Fresh runs reach the target within their error, and true levers with it are within the limits."""
    assert story.confirmation.outcome == "confirmed"
    assert story.loosened > 1.5 * story.short[1]
    beyond, count = story.fresh
    assert count == 400
    assert beyond <= 3


def test_table(story):
    """Each line of the table has as many cells as its head."""
    table = [line for line in lines(story) if line.startswith("|")]
    assert table[0] == HEAD
    assert {line.count("|") for line in table[1:]} == {6}
