"""Control charts: limits by hand and by numpy, the three tests on known runs, and how often chance marks a point."""

import math

import numpy as np
import pytest

from reporting.capability.control_chart import MOST_POINTS, control_chart
from reporting.trust.evidence import BEYOND_BAR


def test_few_values_are_individuals_with_sigma_from_moving_ranges() -> None:
    """Montgomery's form: mean moving range divided by d2 = 1.128 for two values."""
    found = control_chart(np.array([1.0, 3.0, 2.0, 5.0, 4.0]))
    sigma = (2 + 1 + 3 + 1) / 4 / 1.1283791670955126
    assert (found.of, found.size, found.centre) == ("values", 1, 3.0)
    assert (found.low, found.high) == pytest.approx((3 - 3 * sigma, 3 + 3 * sigma))
    assert found.marked == ()


def test_many_values_are_means_with_the_sigma_within_them() -> None:
    x = np.random.default_rng(1).normal(5.0, 2.0, 500)
    found, groups = control_chart(x), x.reshape(50, 10)
    half = 3 * math.sqrt(groups.var(axis=1, ddof=1).mean() / 10)
    assert (found.of, found.size, len(found.points)) == ("means", 10, 50)
    assert found.points == pytest.approx(groups.mean(axis=1))
    assert (found.low, found.high) == pytest.approx((x.mean() - half, x.mean() + half))


@pytest.mark.parametrize("n", [61, 100, 999, 1000, 12_345])
def test_every_value_is_in_one_of_at_most_sixty_points(n) -> None:
    x = np.random.default_rng(2).normal(size=n)
    found = control_chart(x)
    assert 5 <= len(found.points) <= MOST_POINTS
    assert len(found.points) == n // found.size


def test_lots_are_a_chart_of_their_means() -> None:
    """Lots that differ much more than their values do are no alarm: sigma is that between lots."""
    rng = np.random.default_rng(3)
    lots = np.repeat(np.arange(20), 25)
    x = rng.normal(size=20)[lots] + 0.01 * rng.normal(size=500)
    found = control_chart(x, lots)
    assert (found.of, found.size) == ("lots", 1)
    assert found.points == pytest.approx([x[lots == lot].mean() for lot in range(20)])
    assert not found.beyond


def test_each_test_marks_where_its_run_is_complete() -> None:
    """Nine on one side, six that rise, one far out; each is marked by its own test."""
    quiet = [0.1, -0.1] * 8
    side = control_chart(np.array([*quiet, *[0.05, 0.06] * 5, *quiet]))
    assert next(at for at in side.one_side if at >= 16) == 16 + 9 - 1
    rising = control_chart(np.array([*quiet, -0.3, -0.2, -0.05, 0.05, 0.2, 0.3, *quiet]))
    assert 16 + 6 - 1 in rising.trend
    far = control_chart(np.array([*quiet, 3.0, *quiet]))
    assert far.beyond == (16,)
    assert set(far.marked) >= {16}


def test_chance_marks_as_many_points_as_is_said() -> None:
    """400 stable processes: the expected number holds to 15 %, of which chance in this test is a third."""
    rng = np.random.default_rng(4)
    charts = [control_chart(rng.normal(size=6000)) for _ in range(400)]
    marked = sum(len(c.beyond) + len(c.one_side) + len(c.trend) for c in charts)
    assert marked / sum(c.by_chance for c in charts) == pytest.approx(1.0, abs=0.15)


def test_there_is_none_of_few_or_equal_values() -> None:
    assert control_chart(np.arange(4.0)) is None
    assert control_chart(np.full(50, 7.0)) is None
    assert control_chart(np.arange(8.0), np.repeat([0, 1], 4)) is None


def test_three_points_beyond_the_limits_are_no_chance():
    """Of 500 stable processes of four shapes, at most as many have them as docs/measured.md says, within chance."""
    rng = np.random.default_rng(5)
    shapes = {
        "normal": lambda n: rng.normal(size=n),
        "gamma": lambda n: rng.gamma(16.0, size=n),
        "lognormal": lambda n: np.exp(0.3 * rng.normal(size=n)),
        "t": lambda n: rng.standard_t(5, size=n),
    }
    for name, draw in shapes.items():
        alarms = sum(len(control_chart(draw(60)).beyond) >= BEYOND_BAR for _ in range(500))
        assert alarms <= 24, name  # more than 24 of 500 at 2.1 % has a probability of 1e-4
