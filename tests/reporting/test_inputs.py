"""Were the inputs what was asked: against scipy, and false alarms counted."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from reporting.inputs import analyse_correlations, analyse_variable
from reporting.samples import read_samples
from reporting.spec import VariableSpec
from tests.reporting.synthetic import c60_spec, c60_table

GRID = np.linspace(-4, 4, 2001)
NORMAL = VariableSpec(
    "x", "mm", "normal", None, None, 0.0, 1.0, (), "", tuple(zip(GRID, stats.norm.cdf(GRID), strict=True))
)


def test_the_distance_is_kolmogorovs() -> None:
    """On a fine grid: never above scipy's, and below it by no more than the grid is wide."""
    for seed in range(20):
        x = np.random.default_rng(seed).normal(0.05 * seed, 1.0, 400)
        found, right = analyse_variable(NORMAL, x, np.arange(400)), stats.kstest(x, "norm")
        assert right.statistic - 0.004 <= found.distance <= right.statistic + 1e-12
        assert found.p_value == pytest.approx(stats.kstwobign.sf(found.distance * 20), rel=1e-9)


@pytest.mark.parametrize("std", [1.0, 1.3])
def test_errors_of_mean_and_sigma_are_those_of_the_values(std) -> None:
    """Three in a thousand beyond 3 where it is right; almost all where sigma is off."""
    rng = np.random.default_rng(3)
    found = [analyse_variable(NORMAL, rng.normal(0, std, 500), np.arange(500)) for _ in range(400)]
    far = np.mean([f.std_errors > 3 for f in found])
    assert far < 0.03 if std == 1.0 else far > 0.95
    assert np.mean([f.mean_errors > 3 for f in found]) < 0.02


def test_batches_do_not_cry_wolf() -> None:
    """Shifts of batches of 100 move the mean ten times as far as independent values would."""
    rng = np.random.default_rng(8)
    spec, sample = replace(NORMAL, batch=100), np.arange(6000)
    errors = []
    for _ in range(200):
        x = np.repeat(rng.normal(0, 0.8, 60), 100) + rng.normal(0, 0.6, 6000)
        errors.append((analyse_variable(spec, x, sample), analyse_variable(NORMAL, x, sample)))
    assert np.mean([b.mean_errors > 4 for b, _ in errors]) < 0.02
    assert np.mean([b.std_errors > 4 for b, _ in errors]) < 0.05
    assert np.mean([plain.mean_errors > 4 for _, plain in errors]) > 0.3  # as if they were independent
    assert errors[0][0].p_value is None


def test_rank_correlations_are_scipys_with_ties_and_holes() -> None:
    table, spec = c60_table(300), c60_spec(300)
    x = np.round(np.random.default_rng(1).normal(0.07, 0.0175, 300), 2)
    y = 0.5 * x + np.random.default_rng(2).normal(0, 0.01, 300)
    for name, column in (("J1", x), ("J2", y)):
        table = table.set_column(table.schema.get_field_index(name), name, pa.array(column))
    spec = replace(spec, correlations=(("J2", "J1", 0.6),))
    asked, other = analyse_correlations(spec, read_samples(table, spec))
    right = stats.spearmanr(x, y).statistic
    assert (asked.first, asked.second, asked.asked) == ("J1", "J2", 0.6)
    assert asked.found == pytest.approx(right, abs=1e-12)
    assert asked.errors == pytest.approx((right - 0.6) / (1 - 0.36) * np.sqrt(299))
    assert other.asked == 0.0


def test_correlations_of_many_rows_are_of_all_of_them():
    """Of 300,000 rows, 200,000 are taken: not the first, which may differ from the last."""
    n = 300_000
    x, y = np.random.default_rng(1).standard_normal((2, n))
    y[200_000:] = x[200_000:]
    table, spec = c60_table(40), c60_spec(40)
    few = read_samples(table, spec)
    spec = replace(spec, variables=spec.variables[:2], correlations=())
    values = few.values | {spec.variables[0].name: x, spec.variables[1].name: y}
    (found,) = analyse_correlations(spec, replace(few, values=values, sample=np.arange(n)))
    assert found.found == pytest.approx(1.0 / 3.0, abs=0.02)


@pytest.mark.parametrize("x", [np.zeros(0), np.array([np.nan] * 50), np.array([0.1])])
def test_nothing_drawn_is_none(x) -> None:
    found = analyse_variable(NORMAL, x, np.arange(x.size))
    assert (found.distance, found.mean_errors) == (None, None)


def test_no_bar_lies_beyond_the_bounds() -> None:
    """Of a uniform variable whose values reach its bounds."""
    spec = VariableSpec("P3", "mm", "uniform", 0.02, 0.08, 0.05, 0.0173, ())
    values = np.random.default_rng(1).uniform(0.02, 0.08, 500)
    edges = analyse_variable(spec, values, np.arange(500)).histogram.edges
    assert (edges[0], edges[-1]) == (0.02, pytest.approx(0.08, abs=1e-12))
