"""Draws of parameters in proportion to the likelihood, against distributions known in closed form."""

import numpy as np
import pytest
from scipy import stats

from reporting.shape.fitting import SEARCHED, fit_families
from reporting.shape.sorted_sample import bin_sample
from reporting.shape.supported_indices import parameter_draws, weighted_interval


def test_draws_of_a_normal_mean_and_sigma_are_those_of_theory() -> None:
    """With flat priors of mean and log sigma: Student's t, and chi-square, here with one part in 50 fewer values."""
    x = np.sort(np.random.default_rng(1).normal(5, 2, 100))
    fit = fit_families(x, names=["normal"]).of("normal")
    theta, weights = parameter_draws(fit, bin_sample(x, SEARCHED))
    assert weights.sum() == pytest.approx(1.0)
    means = fit.shift + fit.scale * theta[:, 0]
    known = stats.t(97, x.mean(), x.std() / np.sqrt(97)).ppf([0.025, 0.975])
    assert weighted_interval(means, weights, 0.95) == pytest.approx(tuple(known), abs=0.04)
    sigmas = fit.scale * np.exp(theta[:, 1])
    known = x.std() * np.sqrt(98 / stats.chi2(97).ppf([0.975, 0.025]))
    assert weighted_interval(sigmas, weights, 0.95) == pytest.approx(tuple(known), abs=0.04)


def test_a_flat_likelihood_keeps_the_draws_within_reach() -> None:
    """Johnson's SU has no maximum on normal values: its likelihood rises towards the normal distribution's."""
    x = np.sort(np.random.default_rng(2).uniform(size=200))
    fit = fit_families(x, names=["johnson_su"]).of("johnson_su")
    theta, weights = parameter_draws(fit, bin_sample(x, SEARCHED))
    assert np.all(np.isfinite(theta))
    assert np.all(np.isfinite(weights))


def test_quantiles_of_weighted_values() -> None:
    values = np.arange(1.0, 101.0)[::-1]
    assert weighted_interval(values, np.full(100, 0.01), 0.9) == pytest.approx((5.5, 95.5), abs=0.6)
    heavy = np.where(values == 50, 0.99, 0.01 / 99)
    assert weighted_interval(values, heavy, 0.9) == pytest.approx((50, 50), abs=1)
