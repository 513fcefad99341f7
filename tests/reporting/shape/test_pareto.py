"""Both estimators of the generalized Pareto distribution against scipy's fit, its goodness of fit and its interval."""

import numpy as np
import pytest
from scipy import stats

from reporting.shape import pareto

RNG = np.random.default_rng(31)


@pytest.mark.parametrize("shape", [-0.3, 0.0, 0.2])
def test_the_pareto_fit_is_scipys(shape: float) -> None:
    y = np.sort(stats.genpareto(shape, scale=0.7).rvs(400, random_state=5))
    found = pareto.maximum_likelihood_fit(y)
    known = stats.genpareto.fit(y, floc=0)
    best = stats.genpareto.logpdf(y, *known).sum()
    assert found.loglik == pytest.approx(best, abs=1e-3)
    assert found.shape == pytest.approx(known[0], abs=2e-3)
    assert found.scale == pytest.approx(known[2], rel=2e-3)
    model = stats.genpareto(found.shape, scale=found.scale)
    assert found.survival(3.0) == pytest.approx(model.sf(3.0), rel=1e-9)
    assert pareto.cramer_von_mises(y, found) == pytest.approx(stats.cramervonmises(y, model.cdf).statistic, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [-0.25, 0.1])
def test_the_goodness_check_rejects_one_good_tail_in_twenty(shape: float) -> None:
    """500 tails of 100 excesses; three binomial standard errors are 0.029."""
    draws = stats.genpareto(shape).rvs((500, 100), random_state=8)
    rejected = 0
    for y in np.sort(draws, axis=1):
        found = pareto.maximum_likelihood_fit(y)
        rejected += pareto.cramer_von_mises(y, found) > pareto.critical_cramer_von_mises(found.shape)
    assert rejected / 500 == pytest.approx(0.05, abs=0.03)


@pytest.mark.slow
def test_the_profile_interval_covers_the_share() -> None:
    """200 samples of 150 exponential excesses, share e^-6; three binomial standard errors are 0.046."""
    draws = np.random.default_rng(1).exponential(size=(200, 150))
    inside = 0
    for y in draws:
        low, high = pareto.survival_interval(y, 6.0, pareto.maximum_likelihood_fit(y), 0.95)
        inside += low <= np.exp(-6) <= high
    assert inside / 200 == pytest.approx(0.95, abs=0.047)


@pytest.mark.parametrize("k", [-0.5, 0.0, 0.3, 0.7, 1.2])
def test_the_posterior_mean_finds_shape_and_scale(k):
    """Of 2,000 values; the prior of ten values at 0.5 is removed for the comparison."""
    samples = np.sort(stats.genpareto.rvs(k, scale=3.0, size=(20, 2000), random_state=RNG), axis=1)
    shape, scale = np.mean([pareto.posterior_mean_fit(x) for x in samples], axis=0)
    assert (shape * 2010 - 5) / 2000 == pytest.approx(k, abs=0.03)
    assert scale == pytest.approx(3.0, rel=0.03)


def test_a_short_tail_is_drawn_towards_one_half():
    """Of 40 uniform values (k = -1), by the weight of ten: (40 (-1) + 5) / 50."""
    found = [pareto.posterior_mean_fit(np.sort(RNG.uniform(size=40)))[0] for _ in range(200)]
    assert np.mean(found) == pytest.approx(-0.7, abs=0.08)


def test_the_posterior_mean_is_close_to_maximum_likelihood():
    """On one sample, scipy's fit of the same distribution."""
    x = np.sort(stats.genpareto.rvs(0.4, size=3000, random_state=RNG))
    k, scale = pareto.posterior_mean_fit(x)
    shape, _, size = stats.genpareto.fit(x, floc=0)
    assert k == pytest.approx(shape, abs=0.02)
    assert scale == pytest.approx(size, rel=0.02)
