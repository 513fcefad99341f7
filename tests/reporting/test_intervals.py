"""Intervals against scipy's distributions, and their coverage by simulation."""

import math

import numpy as np
import pytest
from scipy import stats

from reporting import capability
from reporting.intervals import noncentral_t_cdf, one_sided_interval, share_lower_bound, share_upper_bound


@pytest.mark.parametrize("n", [2, 3, 10, 50, 500, 30_850])
@pytest.mark.parametrize("index", [0.01, 0.3, 1.33, 4.58])
def test_noncentral_t_is_that_of_scipy(n: int, index: float) -> None:
    t = 3 * math.sqrt(n) * index
    for low_or_high in one_sided_interval(index, n, 0.95):
        delta = 3 * math.sqrt(n) * low_or_high
        assert noncentral_t_cdf(t, n - 1, delta) == pytest.approx(stats.nct.cdf(t, n - 1, delta), abs=1e-9)


@pytest.mark.parametrize("index", [-2.0, 0.0, 1e-12, 50.0, 1e6])
def test_exact_interval_holds_far_out(index: float) -> None:
    """For n = 50 and large indices the limits scale like those of sigma; at zero they are those of a mean."""
    low, high = one_sided_interval(index, 50, 0.95)
    assert low < index < high
    if index > 100:
        assert low / index == pytest.approx(math.sqrt(stats.chi2.ppf(0.025, 49) / 49), rel=1e-6)
    if index < 1e-6:
        assert one_sided_interval(-index, 50, 0.95) == pytest.approx((-high, -low))
    if abs(index) < 1e-6:
        assert high == pytest.approx(1.959963984540054 / (3 * math.sqrt(50)), rel=1e-9)


@pytest.mark.parametrize(("count", "n"), [(0, 10), (1, 10), (5, 500), (9, 10), (10, 10)])
def test_clopper_pearson_is_scipys(count: int, n: int) -> None:
    result = stats.binomtest(count, n)
    two_sided = result.proportion_ci(0.90, method="exact")
    assert share_lower_bound(count, n, 0.95) == pytest.approx(two_sided.low, abs=1e-12)
    assert share_upper_bound(count, n, 0.95) == pytest.approx(two_sided.high, abs=1e-12)


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    """1,500 campaigns of 60 normal samples, true Cp 1.33, Cpl 1.0, Cpu 1.66.

    Three binomial standard errors are 0.017; Bissell's approximation is allowed one more percent.
    """
    draws = np.random.default_rng(2018).normal(size=(1500, 60))
    truth = {"cp": (3.0 + 4.98) / 6, "cpl": 1.0, "cpu": 1.66, "cpk": 1.0}
    inside = dict.fromkeys(truth, 0)
    for x in draws:
        c = capability(x, -3.0, 4.98)
        for name, true in truth.items():
            low, high = getattr(c, f"{name}_interval")
            inside[name] += low <= true <= high
    for name, count in inside.items():
        assert count / 1500 == pytest.approx(0.95, abs=0.027 if name == "cpk" else 0.017), name


def test_ppm_bound_covers_a_rare_reject() -> None:
    """Of 4,000 campaigns with a true share of 1 %, at most 5 % have their 95 % upper bound below it."""
    rejects = np.random.default_rng(5).binomial(200, 0.01, size=4000)
    missed = np.mean([share_upper_bound(int(k), 200, 0.95) < 0.01 for k in rejects])
    assert missed <= 0.05 + 3 * math.sqrt(0.05 * 0.95 / 4000)
