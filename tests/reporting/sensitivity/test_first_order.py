"""First-order indices against models whose indices are known, and against the classes they replace."""

import numpy as np
import pytest

from reporting.arrays import random_rows
from reporting.sensitivity.first_order import effects, jackknife_quantile, most_degree
from reporting.sensitivity.polynomials import basis_of, group_sums, groups_of
from tests.reporting.models import ISHIGAMI_FIRST, LINEAR_FIRST, ishigami, linear


def of_sample(x, y, independent=True):
    """Return the effects on one response."""
    ends = tuple(np.quantile(x, [0.05, 0.95], axis=0))
    sums = group_sums(x, y[:, None], most_degree(*x.shape))
    return effects(sums, x, y[:, None], groups_of(y.size), ends, independent=independent)


def classes(x, y):
    """Return first-order indices by classes of equal probability, unbiased within them (the textbook estimator)."""
    n, count = y.size, int(np.clip(2 * y.size ** (1 / 3), 5, 50))
    shares = []
    for column in x.T:
        at = np.argsort(np.argsort(column)) * count // n
        mean = np.bincount(at, y) / np.bincount(at)
        shares.append(1 - np.sum((y - mean[at]) ** 2) / (n - count) / np.var(y, ddof=1))
    return np.array(shares)


@pytest.mark.parametrize("degree", [1, 5, 10])
def test_the_basis_is_orthonormal_whatever_the_unit(degree):
    """Also of a skew variable, far from zero; the Gram matrix of one variable is the identity."""
    x = 1e6 + 1e-3 * np.random.default_rng(1).gamma(4.0, size=(3000, 1))
    values = basis_of(x, degree)(x)
    assert values.T @ values / 3000 == pytest.approx(np.eye(1 + degree), abs=1e-6)


def test_a_variable_of_three_values_ends_its_basis():
    """Polynomials of degree 3 and more vanish on three points."""
    x = np.repeat([0.0, 1.0, 4.0], 50)[:, None]
    values = basis_of(x, 5)(x)
    assert np.all(values[:, 3:] == 0)
    assert values[:, :3].T @ values[:, :3] / 150 == pytest.approx(np.eye(3), abs=1e-12)


def test_rows_are_dealt_once_each():
    """And not in the order of a sequence."""
    assert sorted(random_rows(1000)) == list(range(1000))
    assert np.array_equal(random_rows(1000), random_rows(1000))
    assert np.max(np.bincount(random_rows(1000)[::20] % 4)) < 25


@pytest.mark.slow
@pytest.mark.parametrize(("model", "truth", "n"), [(ishigami, ISHIGAMI_FIRST, 100), (ishigami, ISHIGAMI_FIRST, 500),
                                                   (linear, LINEAR_FIRST, 500), (ishigami, ISHIGAMI_FIRST, 30_000),
                                                   (linear, LINEAR_FIRST, 30_000)])  # fmt: skip
def test_closer_than_classes(model, truth, n):
    """Root mean square over samples: never worse for the largest share, several times better for the small ones.

    The bars are 1.5 times what 200 samples gave; the intervals hold the truth in at least 80 % of the samples
    (95 % nominal, 30 samples: a chance of 1e-3 to fail, each).
    """
    rng, repeats = np.random.default_rng(n), 30 if n < 10_000 else 5
    together, alone, by_class, inside = [], [], [], []
    for _ in range(repeats):
        x, y = model(n, rng)
        found = of_sample(x, y)
        together.append(found.share[0] - truth)
        alone.append(of_sample(x, y, independent=False).share[0] - truth)
        by_class.append(classes(x, y) - truth)
        inside.append(np.abs(found.share[0] - truth) <= jackknife_quantile(20, 0.95) * found.share_error[0] + 1e-12)
    error, one, old = (np.sqrt(np.mean(np.square(e), axis=0)) for e in (together, alone, by_class))
    bar = {100: 0.13, 500: 0.055, 30_000: 0.008}[n]
    assert error.max() < bar
    assert one.max() < bar
    assert error.max() < 1.35 * old.max()
    small = truth < 0.1
    assert np.all(error[small] < old[small])
    if repeats == 30:
        assert np.mean(np.array(inside)[:, truth > 0.01], axis=0).min() >= 0.8


def test_correlated_variables_keep_the_meaning_of_the_index():
    """Y = X1, X2 merely correlated with it (0.6): Var E[Y | X2] / Var Y is 0.36, not 0."""
    rng = np.random.default_rng(4)
    x1 = rng.normal(size=20_000)
    x = np.column_stack([x1, 0.6 * x1 + 0.8 * rng.normal(size=x1.size)])
    assert of_sample(x, x1, independent=False).share[0] == pytest.approx([1.0, 0.36], abs=0.015)
    assert of_sample(x, x1, independent=True).share[0] == pytest.approx([1.0, 0.0], abs=0.015)


def test_what_is_left_is_interaction():
    """Ishigami: x1 and x3 together explain 0.2437."""
    found = of_sample(*ishigami(30_000, np.random.default_rng(3)))
    assert found.unexplained[0] == pytest.approx(0.2436836641, abs=3.5 * found.unexplained_error[0] + 1e-3)
    assert found.unexplained_error[0] < 0.005


def test_the_curve_is_the_conditional_expectation():
    """Ishigami: E[y | x1] = sin(x1) (1 + 0.1 pi^4 / 5), E[y | x2] = 7 sin^2(x2) about the mean."""
    x, y = ishigami(50_000, np.random.default_rng(6))
    found = of_sample(x, y)
    curve = found.curve[0] * y.std()
    expected = np.sin(found.curve_x[0]) * (1 + np.pi**4 / 50)
    assert curve[0] == pytest.approx(expected, abs=0.08)
    assert curve[1] == pytest.approx(7 * np.sin(found.curve_x[1]) ** 2 - 3.5, abs=0.08)


def test_a_response_without_noise_takes_the_lowest_degree():
    """A weighted sum is a polynomial of degree 1, and its shares are those of the sample to rounding."""
    x, y = linear(500, np.random.default_rng(8))
    found = of_sample(x, y)
    assert found.degree[0] == 1
    assert found.unexplained[0] == pytest.approx(0.0, abs=1e-9)
