"""Control charts: limits by hand and by numpy, the three tests on known runs, and how often chance marks a point."""

import math

import numpy as np
import pytest

from reporting.capability.row_order import MOST_POINTS, RULES, control_chart, moving_averages
from reporting.capability.within import d2, subgroup_sigmas
from reporting.errors import ReportError
from reporting.spec import ChartPlan
from reporting.trust.evidence import BEYOND_BAR
from tests.each import each

# Inside diameters of 25 samples of 5 piston rings [mm]: Montgomery, Introduction to Statistical Quality Control, table
# 6.3, as thousandths from 74.
PISTON_RINGS = 74 + 0.001 * np.array(
    [
        30,
        2,
        19,
        -8,
        8,
        -5,
        -8,
        1,
        11,
        4,
        -12,
        24,
        21,
        5,
        2,
        2,
        -4,
        -7,
        15,
        9,
        -8,
        7,
        15,
        -11,
        14,
        9,
        -6,
        -3,
        -15,
        -7,
        -5,
        6,
        -6,
        0,
        5,
        -15,
        3,
        -7,
        15,
        -12,
        8,
        -5,
        9,
        5,
        4,
        -2,
        0,
        -10,
        7,
        -5,
        -6,
        -2,
        -6,
        -5,
        -10,
        4,
        0,
        7,
        0,
        -4,
        -17,
        2,
        -2,
        -3,
        12,
        6,
        -33,
        -6,
        0,
        -16,
        12,
        14,
        -2,
        -1,
        7,
        0,
        -16,
        5,
        -2,
        -4,
        -6,
        12,
        -14,
        5,
        7,
        6,
        10,
        18,
        3,
        0,
        -16,
        2,
        3,
        5,
        -3,
        0,
        10,
        13,
        20,
        3,
        -18,
        1,
        15,
        5,
        -4,
        4,
        -1,
        -10,
        6,
        9,
        10,
        -11,
        -10,
        9,
        14,
        15,
        8,
        -7,
        0,
        10,
        -18,
        -16,
        -5,
        17,
        13,
    ]
)


def test_few_values_are_individuals_with_sigma_from_moving_ranges() -> None:
    """Montgomery's form: mean moving range divided by d2 = 1.128 for two values."""
    found = control_chart(np.array([1.0, 3.0, 2.0, 5.0, 4.0]))
    sigma = (2 + 1 + 3 + 1) / 4 / 1.1283791670955126
    assert (found.of, found.size, found.centre) == ("values", 1, 3.0)
    assert (found.low[0], found.high[-1]) == pytest.approx((3 - 3 * sigma, 3 + 3 * sigma))
    assert found.marked == ()


def test_many_values_are_means_with_the_sigma_within_them() -> None:
    x = np.random.default_rng(1).normal(5.0, 2.0, 500)
    found, groups = control_chart(x), x.reshape(50, 10)
    half = 3 * math.sqrt(groups.var(axis=1, ddof=1).mean() / 10)
    assert (found.of, found.size, len(found.points)) == ("means", 10, 50)
    assert found.points == pytest.approx(groups.mean(axis=1))
    assert (found.low[7], found.high[9]) == pytest.approx((x.mean() - half, x.mean() + half))


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


QUIET = [0.1, -0.1] * 8
# Patterns after QUIET in sigmas, the test that they break, and the place of their last point.
PATTERNS = {
    "nelson 1": [3.1],
    "nelson 2": [0.1, 0.2] * 4 + [0.1],
    "nelson 3": [-0.3, -0.2, -0.05, 0.05, 0.2, 0.3],
    "nelson 4": [],
    "nelson 5": [2.1, 0.0, 2.1],
    "nelson 6": [-1.1, -1.1, 0.5, -1.1, -1.1],
    "nelson 7": [],
    "nelson 8": [1.1, -1.1, -1.2, 1.1, 1.3, -1.1, 1.2, -1.4],
    "western electric 4": [0.2, 0.3] * 4,
}


@each("name", PATTERNS)
def test_each_test_marks_where_its_pattern_is_complete(name) -> None:
    """Its pattern without the first point is no pattern; so long a row as QUIET alternates and hugs the centre."""
    rule, pattern = RULES[name], np.array(PATTERNS[name])
    apart = np.array([0.1, 0.1, -0.1] * 3)
    for points, complete in ((np.r_[apart, pattern], True), (np.r_[apart, pattern[1:]], False)):
        if pattern.size:
            assert rule.marked(points)[-1] == complete
    quiet = np.flatnonzero(rule.marked(np.array(QUIET)))
    assert quiet.tolist() == {"nelson 4": [13, 14, 15], "nelson 7": [14, 15]}.get(name, [])


def test_chance_marks_as_many_points_as_is_said() -> None:
    """Each test by itself, on 2,000,000 points of stable normal processes: its chance to 4 % and 4 standard errors."""
    z = np.random.default_rng(4).normal(size=(1000, 2000))
    for name, rule in RULES.items():
        share, expected = rule.marked(z)[:, rule.first :].mean(), rule.chance
        assert share == pytest.approx(expected, rel=0.04, abs=8 * math.sqrt(expected / z.size)), name


def test_piston_rings() -> None:
    """Montgomery: mean range 0.581 / 25, limits 73.988 and 74.014 (A2 0.577), 0.049 (D4 2.114); mean s 0.0094."""
    groups = np.arange(125) // 5
    found = control_chart(PISTON_RINGS, None, ChartPlan(), groups)
    assert (found.kind, found.of, found.size, found.beyond) == ("xbar-r", "subgroups", 5, ())
    assert found.centre == pytest.approx(74.001176)
    assert (found.low[0], found.high[0]) == (pytest.approx(73.988, abs=5e-4), pytest.approx(74.014, abs=7e-4))
    assert found.high[0] - found.centre == pytest.approx(0.577 * 0.581 / 25, rel=1e-3)
    ranges = found.spread
    assert (ranges.of, ranges.beyond) == ("ranges", ())
    assert (ranges.centre[0], ranges.low[0]) == (pytest.approx(0.581 / 25), 0.0)
    assert ranges.high[0] == pytest.approx(2.114 * 0.581 / 25, rel=5e-4)
    sigmas = control_chart(PISTON_RINGS, None, ChartPlan("xbar-s"), groups)
    assert sigmas.spread.centre[0] == pytest.approx(0.0094, abs=5e-5)
    assert sigmas.spread.high[0] == pytest.approx(0.0196, abs=1e-4)
    assert sigmas.high[0] == pytest.approx(74.014, abs=7e-4)


def test_moving_averages_of_the_nist_handbook() -> None:
    """NIST/SEMATECH e-Handbook of Statistical Methods, 6.3.2.4: weight 0.3, target 50, sigma 2.0539."""
    x = np.array([52.0, 47.0, 53.0, 49.3, 50.1, 47.0, 51.0, 50.1, 51.2, 50.5])
    x = np.append(x, [49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1])
    published = [50.60, 49.52, 50.56, 50.18, 50.16, 49.21, 49.75, 49.85, 50.26, 50.33, 50.11, 49.36, 49.52, 50.05]
    published += [49.38, 49.92, 50.73, 51.23, 51.94, 51.99]
    scores, wide = moving_averages((x[None, :] - 50) / 2.0539, np.ones(20, int), 0.3)
    assert 50 + 2.0539 * scores[0] * wide == pytest.approx(published, abs=0.0051)
    assert 50 + 3 * 2.0539 * wide[-1] == pytest.approx(52.5884, abs=5e-4)


def test_a_chart_of_moving_averages() -> None:
    """Its last limits are those of Lucas and Saccucci (1990), its points those of a loop; only its limits are tests."""
    x = np.random.default_rng(6).normal(5, 2, 40)
    found = control_chart(x, None, ChartPlan("ewma", weight=0.2))
    sigma = np.abs(np.diff(x)).mean() / d2(2)
    average, expected = x.mean(), []
    for value in x:
        average = 0.2 * value + 0.8 * average
        expected.append(average)
    assert found.points == pytest.approx(expected)
    assert found.high[-1] - found.centre == pytest.approx(3 * sigma * math.sqrt(0.2 / 1.8), rel=1e-6)
    assert found.high[0] - found.centre == pytest.approx(0.6 * sigma)
    assert (list(found.marks), found.spread.of) == (["beyond the limits"], "moving ranges")


def test_random_orders_tell_a_change_of_the_mean_or_the_spread() -> None:
    """They are as rare as is said with long tails, too; what changes is alarming in its own chart."""
    rng, groups = np.random.default_rng(7), np.arange(100) // 4
    plan = ChartPlan(rules=tuple(name for name in RULES if name.startswith("western")))
    stable = [control_chart(rng.standard_t(5, 100), None, plan, groups) for _ in range(60)]
    for p in ([c.p for c in stable], [c.spread.p for c in stable]):
        assert sum(each <= 0.05 for each in p) <= 9  # 10 or more of 60 at 5 %: 0.0004
    for process in (np.linspace(-2, 2, 100), np.repeat([0, 2], 50)):
        assert control_chart(process + rng.normal(size=100), None, plan, groups).p == 1 / 400
    wider = np.repeat([0.2, 0.2, 0.2, 2.0, 2.0], 20) * rng.normal(size=100)
    assert control_chart(wider, None, plan, groups).spread.p == 1 / 400
    assert control_chart(wider, None, plan).spread.p == 1 / 400


def test_subgroups_of_other_sizes() -> None:
    """Unequal ones have limits of their own and a chart of standard deviations; one of a single value is left out."""
    sizes = [3, 4, 5, 1, 3, 4, 5, 4]
    x = np.random.default_rng(8).normal(size=sum(sizes))
    found = control_chart(x, None, ChartPlan(), np.repeat(np.arange(8), sizes))
    assert (found.kind, found.left_out, len(found.points)) == ("xbar-s", 1, 7)
    wide = np.array(found.high) - found.centre
    assert wide * np.sqrt([3, 4, 5, 3, 4, 5, 4]) == pytest.approx([3 * found.sigma] * 7)
    assert found.points[1] == pytest.approx(x[3:7].mean())
    assert found.sigma == pytest.approx(
        next(s.std for s in subgroup_sigmas(x, np.repeat(np.arange(8), sizes), None, None) if "c4" in s.method)
    )


def test_charts_that_show_nothing_are_refused() -> None:
    x = np.random.default_rng(9).normal(size=3000)
    for plan, groups in (
        (ChartPlan("i-mr"), None),
        (ChartPlan("xbar-r"), np.arange(3000) // 30),
        (ChartPlan("xbar-s"), None),
    ):
        with pytest.raises(ReportError, match="chart"):
            control_chart(x, None, plan, groups)


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
