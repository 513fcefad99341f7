"""Intervals of quantiles for any distribution: exact ranks, and coverage."""

import numpy as np
import pytest
from scipy import stats

from reporting.shape.nonnormal import ENDS, empirical_indices
from reporting.shape.order_statistics import FEWEST, interval_of_quantiles, quantile_interval


@pytest.mark.parametrize(("n", "share"), [(60, 0.5), (500, 0.1), (3000, 0.99865), (40_000, 0.00135)])
def test_ranks_are_the_binomial_ones(n: int, share: float) -> None:
    """Each end misses with at most 2.5 %, and the next rank inwards would miss more often."""
    low, high = quantile_interval(np.arange(1.0, n + 1), share, 0.95)
    below = stats.binom(n, share)
    assert below.cdf(low - 1) <= 0.025 < below.cdf(low)
    assert below.sf(high - 1) <= 0.025 < below.sf(high - 2)


def test_the_fewest_values_have_both_ends_within_the_sample() -> None:
    x = np.arange(float(FEWEST))
    assert all(quantile_interval(x, share, 0.95) for share in ENDS)
    assert quantile_interval(x[:-1], ENDS[2], 0.95) is None
    assert interval_of_quantiles(x[:-1], ENDS, lambda q: {"q": q[2]}, 0.95) == {}


def test_a_statistic_of_one_quantile_has_its_interval() -> None:
    x = np.sort(np.random.default_rng(1).normal(size=500))
    found = interval_of_quantiles(x, (0.1, 0.5), lambda q: {"q": q[0], "twice": 2 * q[0]}, 0.95)
    low, high = quantile_interval(x, 0.1, 0.95)
    assert found["q"] == pytest.approx((low, high))
    assert found["twice"] == pytest.approx((2 * low, 2 * high))


@pytest.mark.parametrize("n", [2800, 5000, 30_000])
@pytest.mark.parametrize(
    "known", [stats.norm(), stats.t(5), stats.gamma(9), stats.lognorm(0.5)], ids=["normal", "t5", "gamma", "lognormal"]
)
def test_empirical_intervals_cover_the_truth(known, n: int) -> None:
    """100 samples; the bootstrap before covered 82 to 92 % at 2,800. 0.88 is 0.95 less three binomial errors."""
    low, median, high = known.ppf(ENDS)
    lsl, usl = median - 1.3 * (median - low), median + 1.2 * (high - median)
    rng = np.random.default_rng(7)
    inside = []
    for _ in range(100):
        found = empirical_indices(known.ppf(rng.random(n)), lsl, usl)
        inside.append(
            [
                found.ppk_interval[0] <= 1.2 <= found.ppk_interval[1],
                found.pp_interval[0] <= (usl - lsl) / (high - low) <= found.pp_interval[1],
            ]
        )
    assert np.all(np.mean(inside, axis=0) >= 0.88)
