"""Correlations of responses: against scipy and the definition, their intervals by coverage."""

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from reporting.capability.intervals import fisher_interval
from reporting.product_yield import response_correlations
from reporting.samples import read_samples
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table

N = 400


def test_every_pair_agrees_with_scipy():
    """Pearson's r with its interval, and Spearman's; the strongest first; failed samples are left out."""
    spec, table = c60_spec(N), c60_table(N, 7)
    found = response_correlations(read_samples(table, spec), spec, 0.95)
    strengths = [abs(each.pearson) for each in found]
    assert (len(found), strengths) == (21, sorted(strengths, reverse=True))
    ok = np.array(table["status"].to_pylist()) == "ok"
    for each in found:
        x, y = (np.array(table[name].to_numpy(zero_copy_only=False), float)[ok] for name in (each.first, each.second))
        pearson = stats.pearsonr(x, y)
        interval = pearson.confidence_interval(0.95)
        assert each.pearson == pytest.approx(pearson.statistic, abs=1e-12)
        assert each.interval == pytest.approx((interval.low, interval.high), abs=1e-12)
        assert each.rank == pytest.approx(stats.spearmanr(x, y).statistic, abs=1e-12)
        assert each.n == N - 7


def test_intervals_hold_as_often_as_they_say():
    """2,000 pairs of normal columns with r = 0.6: 95 %, within three standard errors."""
    rng, held = np.random.default_rng(8), 0
    for _ in range(2000):
        x = rng.standard_normal(40)
        r = float(np.corrcoef(x, 0.6 * x + 0.8 * rng.standard_normal(40))[0, 1])
        low, high = fisher_interval(r, 40, 0.95)
        held += low <= 0.6 <= high
    assert held / 2000 == pytest.approx(0.95, abs=3 * np.sqrt(0.05 * 0.95 / 2000))


def test_ends_and_few_samples():
    """A perfect correlation has no interval, three pairs every one; 29 samples none at all."""
    assert fisher_interval(1.0, 50, 0.95) == (1.0, 1.0)
    assert fisher_interval(0.3, 3, 0.95) == (-1.0, 1.0)
    spec = c60_spec(29)
    assert response_correlations(read_samples(c60_table(29), spec), spec, 0.95) == ()
    assert len(analysis_of(c60_table(60), c60_spec(60)).response_correlations) == 21


def test_equal_values_correlate_with_nothing():
    """Also where their mean differs from them by rounding, as of 60 times 0.1."""
    spec, table = c60_spec(60), c60_table(60)
    name = spec.responses[0].name
    column = table.column_names.index(name)
    table = table.set_column(column, table.schema.field(name), pa.array(np.full(60, 0.1)))
    found = response_correlations(read_samples(table, spec), spec, 0.95)
    assert (len(found), [each for each in found if name in (each.first, each.second)]) == (15, [])
