"""Regression against numpy, scipy and closed forms."""

import itertools

import numpy as np
import pytest
from scipy import stats

from reporting.sensitivity.polynomials import group_sums
from reporting.sensitivity.regression import linear, rank, shapley_of_r2
from tests.reporting.models import LINEAR_FIRST, WEIGHTS
from tests.reporting.models import linear as linear_model

RNG = np.random.default_rng(12)
COVARIANCE = np.array([[1.0, 0.6, 0.0], [0.6, 4.0, -0.5], [0.0, -0.5, 2.0]])


def correlated(n=400):
    """Return three correlated variables and two responses, far from zero."""
    x = 1e4 + RNG.multivariate_normal([0, 1, 2], COVARIANCE, n)
    return x, np.column_stack([x @ [1.0, -2.0, 0.3] + RNG.normal(size=n), np.exp(x[:, 1] / 5 - 2e3)])


def test_coefficients_are_those_of_least_squares():
    """Standardised, adjusted R^2 by the textbook; variance inflation by regression on the others."""
    x, y = correlated()
    found = linear(group_sums(x, y, 1))
    z, w = stats.zscore(x), stats.zscore(y)
    expected, residual, *_ = np.linalg.lstsq(z, w, rcond=None)
    assert found.coefficient == pytest.approx(expected.T, abs=1e-9)
    assert found.r2 == pytest.approx(1 - residual / 400 * 399 / 396, abs=1e-9)
    assert found.inflation == pytest.approx(np.diag(np.linalg.inv(np.corrcoef(x.T))), rel=1e-9)


def test_standard_errors_are_those_of_theory():
    """Of standardised coefficients with normal noise; the jackknife of 20 groups scatters by a sixth."""
    ratios = []
    for _ in range(60):
        x = RNG.normal(size=(400, 2))
        y = x[:, :1] * 0.0 + x[:, 1:] * 0.0 + RNG.normal(size=(400, 1))
        ratios.append(linear(group_sums(x, y, 1)).coefficient_error[0] * np.sqrt(400))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.08)


def test_contributions_are_averages_over_all_orders():
    """Against the definition, order by order."""
    x, y = correlated()
    among = np.corrcoef(x.T)
    with_y = np.array([[np.corrcoef(a, b)[0, 1] for b in y.T] for a in x.T])

    def r2(members, j):
        r = with_y[list(members), j]
        return r @ np.linalg.solve(among[np.ix_(members, members)], r) if members else 0.0

    expected = np.zeros((3, 2))
    for order in itertools.permutations(range(3)):
        for place, i in enumerate(order):
            for j in range(2):
                expected[i, j] += (r2(order[: place + 1], j) - r2(order[:place], j)) / 6
    assert shapley_of_r2(among[None], with_y[None])[0] == pytest.approx(expected, abs=1e-9)
    assert linear(group_sums(x, y, 1)).contribution == pytest.approx(expected.T, abs=1e-9)


def test_contributions_of_two_correlated_variables_in_closed_form():
    """Y = b1 X1 + b2 X2 with correlation r: b1^2 + r b1 b2 + r^2 (b2^2 - b1^2) / 2, as Groemping (2007) prints."""
    b1, b2, r = 1.0, 0.5, 0.4
    among = np.array([[1.0, r], [r, 1.0]])
    variance = b1**2 + b2**2 + 2 * r * b1 * b2
    with_y = (among @ [b1, b2] / np.sqrt(variance))[None, :, None]
    expected = (b1**2 + r * b1 * b2 + r**2 * (b2**2 - b1**2) / 2) / variance
    assert shapley_of_r2(among[None], with_y)[0, 0, 0] == pytest.approx(expected)


def test_independent_contributions_are_first_order_indices():
    """A weighted sum: squared weights."""
    x, y = linear_model(30_000, RNG)
    found = linear(group_sums(x, y[:, None], 2))
    assert found.contribution[0] == pytest.approx(LINEAR_FIRST, abs=0.015)
    assert found.coefficient[0] == pytest.approx(WEIGHTS / np.linalg.norm(WEIGHTS), abs=0.01)


def test_a_variable_given_twice():
    """They share the coefficient; their variance inflation is infinite."""
    x = RNG.normal(size=(200, 2))
    x = np.column_stack([x, 3 * x[:, 0] + 5])
    found = linear(group_sums(x, (x[:, :1] + 0.1 * x[:, 1:2]), 1))
    assert np.isinf(found.inflation[[0, 2]]).all()
    assert np.isfinite(found.inflation[1])
    assert found.coefficient[0, 0] == pytest.approx(found.coefficient[0, 2], rel=1e-3)
    assert found.contribution[0].sum() == pytest.approx(1.0, abs=1e-6)


def test_ranks_are_scipys():
    """Also with ties; the interval covers as often as Bonett and Wright say."""
    x, y = correlated()
    x = np.round(x, 1)
    found = rank(x, y, 0.95)
    for i in range(3):
        for j in range(2):
            assert found.spearman[j, i] == pytest.approx(stats.spearmanr(x[:, i], y[:, j]).statistic, abs=1e-12)
    ranks = stats.zscore(stats.rankdata(x, axis=0)), stats.zscore(stats.rankdata(y, axis=0))
    assert found.coefficient == pytest.approx(np.linalg.lstsq(*ranks, rcond=None)[0].T, abs=1e-9)
    truth, inside = 6 / np.pi * np.arcsin(0.7 / 2), 0  # Spearman's of a normal pair with correlation 0.7
    for _ in range(800):
        a = RNG.normal(size=100)
        b = 0.7 * a + np.sqrt(0.51) * RNG.normal(size=100)
        r = rank(a[:, None], b[:, None], 0.95)
        inside += r.spearman_low[0, 0] <= truth <= r.spearman_high[0, 0]
    assert inside / 800 == pytest.approx(0.95, abs=0.03)
