"""Gauge studies: AIAG's published examples, sums of squares by hand, coverage of the intervals."""

import numpy as np
import pytest
from scipy import stats

from reporting.errors import ReportError
from reporting.gauge import gauge_bias, gauge_repeatability
from tests.each import each

# AIAG, Measurement Systems Analysis, 4th edition, the study of 10 parts by appraisers A, B, C in 3 trials.
AIAG = np.array(
    [
        [[0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36],
         [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
         [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31]],
        [[0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68],
         [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
         [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50]],
        [[0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49],
         [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
         [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16]],
    ]
)  # fmt: skip
OPERATOR, _, PART = np.meshgrid(list("ABC"), [1, 2, 3], np.arange(10), indexing="ij")
# The same manual's study of linearity: 12 measurements at each of 5 reference values.
LINEARITY = {
    2.0: [2.7, 2.5, 2.4, 2.5, 2.7, 2.3, 2.5, 2.5, 2.4, 2.4, 2.6, 2.4],
    4.0: [5.1, 3.9, 4.2, 5.0, 3.8, 3.9, 3.9, 3.9, 3.9, 4.0, 4.1, 3.8],
    6.0: [5.8, 5.7, 5.9, 5.9, 6.0, 6.1, 6.0, 6.1, 6.4, 6.3, 6.0, 6.1],
    8.0: [7.6, 7.7, 7.8, 7.7, 7.8, 7.8, 7.8, 7.7, 7.8, 7.5, 7.6, 7.7],
    10.0: [9.1, 9.3, 9.5, 9.3, 9.4, 9.5, 9.5, 9.5, 9.6, 9.2, 9.3, 9.4],
}


def test_the_study_of_the_manual():
    """EV .199933, AV .226838, GRR .302373, PV 1.042327; 18.4, 20.9, 27.9, 96.0 % of the study; ndc 4."""
    found = gauge_repeatability(AIAG.ravel(), PART.ravel(), OPERATOR.ravel(), tolerance=6.0)
    squares = {row.source: row.squares for row in found.anova}
    assert squares["operator"] == pytest.approx(3.1673, abs=5e-5)
    assert squares["part"] == pytest.approx(88.3619, abs=5e-5)
    assert squares["repeatability"] == pytest.approx(2.7589 + 0.3590, abs=1e-4)
    assert [row.freedom for row in found.anova] == [2, 9, 78]
    published = {"repeatability": 0.199933, "operator": 0.226838, "gauge R&R": 0.302373, "part": 1.042327}
    assert {name: found.of(name).std for name in published} == pytest.approx(
        published, abs=2e-6
    )  # the manual adds rounded variances
    shares = {"repeatability": 0.184, "operator": 0.209, "gauge R&R": 0.279, "part": 0.960}
    assert {name: found.of(name).study for name in shares} == pytest.approx(shares, abs=5.1e-4)
    assert (found.ndc, found.design, found.parts, found.operators, found.trials) == (4, "crossed", 10, 3, 3)
    assert found.of("gauge R&R").tolerance == pytest.approx(0.302373, abs=2e-6)
    low, high = found.of("repeatability").std_interval  # exact: chi-square
    ends = np.sqrt(78 * 0.199933**2 / stats.chi2.ppf([0.975, 0.025], 78))
    assert (low, high) == pytest.approx(ends, rel=0.005)


def test_an_interaction_is_kept_where_it_is_seen():
    """Mean squares and F by scipy's and by hand: operators that see parts differently."""
    rng = np.random.default_rng(1)
    x = AIAG + 0.8 * rng.normal(size=(3, 1, 10))
    found = gauge_repeatability(x.ravel(), PART.ravel(), OPERATOR.ravel())
    cells = x.mean(axis=1)
    error = x.var(axis=1, ddof=1).mean()
    both = 3 * np.sum((cells - cells.mean(1, keepdims=True) - cells.mean(0) + cells.mean()) ** 2) / 18
    row = next(row for row in found.anova if row.source == "operator by part")
    assert (row.mean_square, row.f) == (pytest.approx(both), pytest.approx(both / error))
    assert row.p == pytest.approx(stats.f.sf(both / error, 18, 60))
    assert found.of("operator by part").std == pytest.approx(np.sqrt((both - error) / 3))
    parts = 9 * cells.mean(0).var(ddof=1)
    assert found.of("part").std == pytest.approx(np.sqrt((parts - both) / 9))


def test_a_nested_study():
    """Each operator has parts of their own: F of parts is that of scipy's one-way analysis within each operator."""
    rng = np.random.default_rng(2)
    x = rng.normal(size=(4, 1, 1)) + rng.normal(size=(4, 6, 1)) + 0.3 * rng.normal(size=(4, 6, 3))
    operator, part = (
        np.broadcast_to(a, x.shape).ravel() for a in (np.arange(4)[:, None, None], np.arange(24).reshape(4, 6, 1))
    )
    found = gauge_repeatability(x.ravel(), part, operator, nested=True)
    error = x.var(axis=2, ddof=1).mean()
    parts = 3 * x.mean(2).var(axis=1, ddof=1).mean()
    operators = 18 * x.mean((1, 2)).var(ddof=1)
    assert [row.freedom for row in found.anova] == [3, 20, 48]
    assert [row.mean_square for row in found.anova] == pytest.approx([operators, parts, error])
    assert found.of("part").std == pytest.approx(np.sqrt((parts - error) / 3))
    assert found.of("operator").std == pytest.approx(np.sqrt(max(operators - parts, 0) / 18))
    alone = gauge_repeatability(x[0].ravel(), part[:18])
    f, p = stats.f_oneway(*x[0])
    assert (alone.anova[0].f, alone.anova[0].p) == (pytest.approx(f), pytest.approx(p))


@pytest.mark.slow
def test_the_intervals_contain_the_truth():
    """95 % intervals of R&R and of its share, 10 parts by 3 operators in 3 trials, 400 studies; and none too long."""
    rng, truth = np.random.default_rng(3), {"gauge R&R": np.hypot(0.2, 0.2), "repeatability": 0.2, "part": 1.0}
    inside = dict.fromkeys(truth, 0)
    share = 0
    for _ in range(400):
        x = rng.normal(size=10) + 0.2 * rng.normal(size=(3, 1, 1)) + 0.2 * rng.normal(size=(3, 3, 10))
        found = gauge_repeatability(x.ravel(), PART.ravel(), OPERATOR.ravel())
        for name, true in truth.items():
            low, high = found.of(name).std_interval
            inside[name] += low <= true <= high
        low, high = found.of("gauge R&R").study_interval
        share += low <= np.sqrt(0.08 / 1.08) <= high
    for name, count in (*inside.items(), ("share", share)):
        assert count >= 366, (name, count)  # fewer than 366 of 400 at 95 %: 0.002


def test_bias_and_linearity_of_the_manual():
    """Biases .491667, .125, .025, -.29167, -.61667; line .73667 - .13167 x, s .23954, R2 71.4 %; t 12.043, 10.158."""
    references = np.repeat(list(LINEARITY), 12)
    found = gauge_bias(np.concatenate(list(LINEARITY.values())), references)
    assert [each.bias for each in found.values] == pytest.approx(
        [0.491667, 0.125, 0.025, -0.291667, -0.616667], abs=1e-6
    )
    line = found.linearity
    assert (line.slope, line.intercept) == (pytest.approx(-0.13167, abs=5e-6), pytest.approx(0.73667, abs=5e-6))
    assert (line.std, line.r2) == (pytest.approx(0.23954, abs=5e-6), pytest.approx(0.714, abs=5e-4))
    t = stats.t.ppf(0.975, 58)
    for value, interval, published in (
        (line.slope, line.slope_interval, 12.043),
        (line.intercept, line.intercept_interval, 10.158),
    ):
        assert abs(value) / ((interval[1] - interval[0]) / 2 / t) == pytest.approx(published, abs=5e-3)


def test_bias_of_the_manual():
    """15 measurements of a part of 6.00: bias .0067, inside an interval around 0; the interval is scipy's."""
    x = np.array([5.8, 5.7, 5.9, 5.9, 6.0, 6.1, 6.0, 6.1, 6.4, 6.3, 6.0, 6.1, 6.2, 5.6, 6.0])
    found = gauge_bias(x, np.full(15, 6.0)).values[0]
    assert found.bias == pytest.approx(0.0067, abs=5e-5)
    assert found.std == pytest.approx(x.std(ddof=1))
    tested = stats.ttest_1samp(x, 6.0)
    assert found.p == pytest.approx(tested.pvalue)
    assert found.interval == pytest.approx(np.array(tested.confidence_interval(0.95)) - 6.0)


@each(
    "change, words",
    [
        (lambda x, p, o: (x[1:], p[1:], o[1:]), "not balanced"),
        (lambda x, p, o: (x, p, np.where(p < 5, "A", "B")), "complete the study"),
        (lambda x, p, o: (x[:10], p[:10], o[:10]), "twice"),
        (lambda x, p, o: (np.where(p == 3, np.nan, x), p, o), "measurement 4"),
        (lambda x, p, o: (p * 1.0, p, o), "resolution"),
        (lambda x, p, o: (x, None, o), "part"),
    ],
)
def test_studies_that_say_nothing_are_refused(change, words):
    with pytest.raises(ReportError, match=words):
        gauge_repeatability(*change(AIAG.ravel(), PART.ravel(), OPERATOR.ravel()))


def test_what_does_not_hold_is_said():
    rng = np.random.default_rng(4)
    x = rng.normal(size=10) + np.array([0.05, 0.05, 1.0])[:, None, None] * rng.normal(size=(3, 3, 10))
    notes = " ".join(gauge_repeatability(x.ravel(), PART.ravel(), OPERATOR.ravel()).notes)
    assert "Bartlett" in notes
    coarse = gauge_repeatability(np.round(AIAG, 0).ravel(), PART.ravel(), OPERATOR.ravel())
    assert "resolution" in " ".join(coarse.notes)
