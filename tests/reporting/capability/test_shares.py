"""Counted shares against scipy's binomial test, and published numbers of runs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from reporting import ReportError
from reporting.capability.shares import counted, expected_normal, nonconforming, ppm_of_z, runs_to_claim


@pytest.mark.parametrize(("count", "n"), [(0, 30_850), (3, 1000), (10, 10)])
def test_intervals_are_clopper_and_pearsons(count: int, n: int) -> None:
    share = counted(count, n, 0.95)
    exact = stats.binomtest(count, n).proportion_ci(0.95, method="exact")
    assert share.interval == pytest.approx((1e6 * exact.low, 1e6 * exact.high), rel=1e-9, abs=1e-9)
    assert share.upper <= share.interval[1] + 1e-9
    assert share.ppm == pytest.approx(1e6 * count / n)


def test_the_papers_claim_needs_46_807_clean_runs() -> None:
    """64 ppm from 30,850 runs without a reject is not proven: they allow 97.1 ppm."""
    assert runs_to_claim(64, 0.95) == 46_807
    assert counted(0, 30_850, 0.95).upper == pytest.approx(97.1017, rel=2e-6)


@given(st.floats(1.0, 5e5), st.integers(0, 5), st.sampled_from([0.9, 0.95, 0.99]))
def test_the_number_of_runs_is_the_fewest(ppm: float, rejects: int, confidence: float) -> None:
    runs = runs_to_claim(ppm, confidence, rejects)
    assert counted(rejects, runs, confidence).upper <= ppm * (1 + 1e-9)
    assert runs == rejects + 1 or counted(rejects, runs - 1, confidence).upper > ppm * (1 - 1e-9)


def test_failures_count_as_rejects_of_all_runs() -> None:
    x = np.array([1.0, 2.0, 3.0, 9.0])
    found = nonconforming(x, 1.5, 4.0, 0.95, failed=6)
    assert (found.below.count, found.above.count, found.total.count) == (1, 1, 2)
    assert found.with_failures == counted(8, 10, 0.95)
    assert nonconforming(x, 1.5, None, 0.95).above is None
    assert nonconforming(x, 1.0, 9.0, 0.95).total.count == 0  # a value on a limit conforms


def test_nothing_to_count_is_none() -> None:
    assert nonconforming(np.array([]), 0.0, 1.0, 0.95) is None
    assert nonconforming(np.array([1.0]), None, None, 0.95) is None


@pytest.mark.parametrize(("ppm", "rejects"), [(0.0, 0), (1e6, 0), (10.0, -1)])
def test_claims_that_nothing_proves_are_refused(ppm: float, rejects: int) -> None:
    with pytest.raises(ReportError):
        runs_to_claim(ppm, 0.95, rejects)


def test_the_normal_share_is_that_of_scipy() -> None:
    found = expected_normal(10.0, 0.5, 8.2, 11.5)
    assert found["below"] == pytest.approx(1e6 * stats.norm.cdf(8.2, 10, 0.5), rel=1e-12)
    assert found["total"] == found["below"] + found["above"]
    assert ppm_of_z(4.5) == pytest.approx(3.39767, rel=2e-6)
    assert expected_normal(10.0, 0.5, None, None) == {}
