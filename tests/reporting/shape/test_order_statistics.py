"""Intervals of quantiles for any distribution: exact ranks, and coverage."""

import numpy as np
import pytest
from scipy import stats

from reporting.errors import finite_in_order
from reporting.shape.nonnormal import ENDS, FEWEST, empirical_indices, interval_of_quantiles, quantile_interval
from reporting.shape.sorted_sample import sorted_sample


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


@pytest.mark.parametrize("n", [2800, 5000])
@pytest.mark.parametrize("spread", [0.0, 0.25, 0.5], ids=["normal", "lognormal(0.25)", "lognormal(0.5)"])
def test_empirical_intervals_cover_the_truth(spread: float, n: int) -> None:
    """100 samples; the bootstrap before covered 82 to 92 % at 2,800. 0.88 is 0.95 less three binomial errors."""

    def shaped(z: np.ndarray) -> np.ndarray:
        return np.expm1(spread * z) / spread if spread else z

    low, median, high = shaped(stats.norm.ppf(ENDS))
    lsl, usl = median - 1.3 * (median - low), median + 1.2 * (high - median)
    rng = np.random.default_rng(7)
    inside = []
    for _ in range(100):
        found = empirical_indices(shaped(rng.normal(size=n)), lsl, usl)
        (ppk_low, ppk_high), (pp_low, pp_high) = found.ppk_interval, found.pp_interval
        inside.append([ppk_low <= 1.2 <= ppk_high, pp_low <= (usl - lsl) / (high - low) <= pp_high])
    assert np.all(np.mean(inside, axis=0) >= 0.88)


def test_finite_values_are_in_order_whatever_order_they_had():
    """Ascending ones are not sorted again."""
    for x in ([1.0, 2.0, 2.0], [2.0, 1.0, 2.0], [2.0, 2.0, 1.0], [np.nan, 2.0, np.inf, 1.0, 2.0]):
        assert finite_in_order(x).tolist() == [1.0, 2.0, 2.0]
    assert finite_in_order([]).size == 0


def test_quantiles_of_a_sorted_sample_are_numpys():
    """To the last bit, at both ends and between."""
    rng, shares = np.random.default_rng(11), [0.0, 0.00135, 0.25, 0.5, 0.75, 0.9, 0.99865, 1.0]
    for n in (1, 2, 3, 10, 999, 1000):
        x = rng.normal(5.0, 2.0, n)
        assert np.array_equal(sorted_sample(x).quantiles(shares), np.quantile(x, shares))
