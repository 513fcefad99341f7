"""Intervals against scipy's distributions, and their coverage by simulation."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats
from scipy.optimize import brentq

from reporting import capability
from reporting.capability.indices import overall_intervals
from reporting.capability.intervals import (
    bench,
    bench_interval,
    cpk_interval,
    cpk_joint_interval,
    cpk_survival,
    cpm_interval,
    noncentral_t_cdf,
    one_sided_interval,
    share_lower_bound,
    share_upper_bound,
)
from reporting.capability.shares import ppm_of_z
from tests.each import each

INDICES = ("cp", "cpk", "cpl", "cpu", "z_lsl", "z_usl", "z_bench")


@each("n", [2, 3, 10, 50, 500, 30_850])
@each("index", [0.01, 0.3, 1.33, 4.58])
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


@pytest.mark.slow
def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    """1,500 campaigns of 60 normal samples, true Cp 1.33, Cpl 1.0, Cpu 1.66, target 0.4 off the mean.

    Three binomial standard errors are 0.017; approximations are allowed one more percent. The printed intervals, of
    which half are not those of normal theory, are allowed 98 %.
    """
    draws = np.random.default_rng(2018).normal(size=(1500, 60))
    truth = {
        "cp_interval": (3.0 + 4.98) / 6,
        "cpl_interval": 1.0,
        "cpu_interval": 1.66,
        "cpk_interval": 1.0,
        "cpk_interval_joint": 1.0,
        "cc_interval": -0.99 / 3.99,
        "cpm_interval": 7.98 / (6 * math.sqrt(1 + 0.4**2)),
        "z_bench_interval": -stats.norm.ppf(stats.norm.cdf(-3.0) + stats.norm.sf(4.98)),
        "ppm_expected_interval": 1e6 * (stats.norm.cdf(-3.0) + stats.norm.sf(4.98)),
    }
    inside, printed, withheld = dict.fromkeys(truth, 0), dict.fromkeys(truth, 0), dict.fromkeys(truth, 0)
    for x in draws:
        c = capability(x, -3.0, 4.98, target=0.4)
        normal = overall_intervals({name: getattr(c, name) for name in INDICES}, c.cc, 60, 0.95)
        normal["cpm_interval"] = cpm_interval(c.cpm, (c.mean - 0.4) / float(np.std(x)), 60, 0.95)
        low, high = normal["z_bench_interval"]
        normal["ppm_expected_interval"] = (ppm_of_z(high), ppm_of_z(low))
        for name, true in truth.items():
            inside[name] += normal[name][0] <= true <= normal[name][1]
            interval = getattr(c, name)
            withheld[name] += interval is None
            printed[name] += interval is not None and interval[0] <= true <= interval[1]
    for name in truth.keys() - {"cpk_interval_joint"}:
        answered = 1500 - withheld[name]
        assert answered >= 0.9 * 1500
        assert 0.95 - 0.017 <= printed[name] / answered <= 0.98, name
    exact = ("cp_interval", "cpl_interval", "cpu_interval", "cc_interval")
    for name, count in inside.items():
        assert count / 1500 == pytest.approx(0.95, abs=0.017 if name in exact else 0.027), name


@pytest.mark.parametrize(("middle", "cpk"), [(0.0, 1.0), (0.0, 0.3), (0.2, 1.0), (-0.5, -0.3)])
def test_the_joint_interval_never_covers_less_than_it_says(middle: float, cpk: float) -> None:
    """20,000 campaigns of 15 values around a centred and an off-centre process, the ends each at 2.5 %.

    Of a binomial share of 2.5 % in 20,000 draws, 0.0033 are three standard errors.
    """
    half = 3 * cpk + middle if cpk > 0 else 0.4
    mean = middle if cpk > 0 else half - 3 * cpk
    x = np.random.default_rng(15).normal(mean, 1, size=(20_000, 15))
    found = np.minimum(half - x.mean(1), half + x.mean(1)) / (3 * x.std(1, ddof=1))
    low, high = observed_limits(cpk, 15)
    assert np.mean(found > high) <= 0.025 + 0.0033
    assert np.mean(found < low) <= 0.025 + 0.0033


def observed_limits(cpk: float, n: int) -> tuple[float, float]:
    """Return between which observed Cpk the joint interval still holds the true one: its ends, inverted."""

    def end(which: int) -> float:
        return brentq(lambda c: cpk_joint_interval(c, n, 0.95)[which] - cpk, -5, 20)

    return end(1), end(0)


def test_the_joint_distribution_of_both_sides_is_that_of_a_simulation() -> None:
    """A centred process of 10 values: 200,000 campaigns give the exact probability to three standard errors."""
    x = np.random.default_rng(4).normal(size=(200_000, 10))
    mean, std = x.mean(1), x.std(1, ddof=1)
    for cpk, observed in ((0.3, 0.2), (0.3, -0.1), (1.0, 1.2)):
        share = np.mean((3 * cpk - np.abs(mean)) / (3 * std) > observed)
        exact = cpk_survival(observed, 10, cpk)
        assert share == pytest.approx(exact, abs=3 * math.sqrt(exact * (1 - exact) / 200_000) + 1e-9)


@given(st.floats(-8, 8), st.floats(-8, 8))
def test_z_bench_is_the_quantile_of_both_tails(z_lsl: float, z_usl: float) -> None:
    """Where scipy still has digits, and only where the limits are in order."""
    assume(z_lsl + z_usl > 1e-3)
    share = stats.norm.sf(z_lsl) + stats.norm.sf(z_usl)
    if 1e-15 < share < 1 - 1e-7:
        assert bench(z_lsl, z_usl) == pytest.approx(stats.norm.isf(share), abs=1e-7)
    assert bench(z_lsl, z_usl) <= min(z_lsl, z_usl) + 1e-9


def test_z_bench_stays_finite_far_out() -> None:
    """At 40 sigma the share is below the smallest double."""
    assert bench(40.0, 60.0) == pytest.approx(40.0, rel=1e-12)
    assert bench(40.0, 40.0) == pytest.approx(40.0 - math.log(2) / 40.0, abs=1e-3)
    low, high = bench_interval(40.0, 60.0, 100, 0.95)
    assert low < 40.0 < high
    assert (low, high) == pytest.approx([3 * end for end in cpk_interval(40 / 3, 100, 0.95)], rel=1e-3)


@pytest.mark.parametrize("confidence", [0.8, 0.99])
def test_boyles_interval_is_exact_at_the_target(confidence: float) -> None:
    """With the mean on the target, n (Cpm / Cpm_hat)^2 is chi-square; a has then no part in it."""
    low, high = cpm_interval(1.2, 0.0, 30, confidence)
    assert low == pytest.approx(1.2 * math.sqrt(stats.chi2.ppf(0.5 - confidence / 2, 30) / 30))
    assert high == pytest.approx(1.2 * math.sqrt(stats.chi2.ppf(0.5 + confidence / 2, 30) / 30))


def test_ppm_bound_covers_a_rare_reject() -> None:
    """Of 4,000 campaigns with a true share of 1 %, at most 5 % have their 95 % upper bound below it."""
    rejects = np.random.default_rng(5).binomial(200, 0.01, size=4000)
    missed = np.mean([share_upper_bound(int(k), 200, 0.95) < 0.01 for k in rejects])
    assert missed <= 0.05 + 3 * math.sqrt(0.05 * 0.95 / 4000)
