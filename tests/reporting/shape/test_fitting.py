"""Fits against scipy's, and against the truth of drawn samples."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from reporting.shape.fitting import JUDGED, SEARCHED, distribution, fit_families
from reporting.shape.sorted_sample import anderson_darling, bin_sample, distance
from tests.each import each

RNG = np.random.default_rng(6)
WEIBULL = 3 * RNG.weibull(2, 500)
SKEWED = np.random.default_rng(7).gamma(3.0, size=500)


@each(
    ("name", "x", "known", "fixed"),
    [
        ("weibull", WEIBULL, stats.weibull_min, {"floc": 0}),
        ("gamma", WEIBULL, stats.gamma, {"floc": 0}),
        ("logistic", WEIBULL, stats.logistic, {}),
        ("exponential", WEIBULL, stats.expon, {"floc": 0}),
        ("log_logistic", WEIBULL, stats.fisk, {"floc": 0}),
        ("weibull_above", 5 + WEIBULL, stats.weibull_min, {}),
        ("gamma_above", 5 + WEIBULL, stats.gamma, {}),
        ("log_logistic_above", 5 + SKEWED, stats.fisk, {}),
        ("largest_extreme", WEIBULL, stats.gumbel_r, {}),
        ("smallest_extreme", WEIBULL, stats.gumbel_l, {}),
        ("half_normal", WEIBULL, stats.halfnorm, {"floc": 0}),
        ("johnson_su", RNG.standard_t(5, 500), stats.johnsonsu, {}),
    ],
)
def test_a_fit_is_at_least_as_likely_as_scipys(name: str, x, known, fixed) -> None:
    """And not more likely than the maximum that scipy finds, to a thousandth of a unit."""
    fit = fit_families(x, names=[name]).of(name)
    parameters = known.fit(x, **fixed)
    best = known.logpdf(x, *parameters).sum()
    assert fit.loglik == pytest.approx(best, abs=2e-3)
    assert fit.aic == pytest.approx(2 * len(fit.theta) - 2 * fit.loglik)
    assert fit.bic == pytest.approx(len(fit.theta) * np.log(x.size) - 2 * fit.loglik)
    limits = known.ppf([0.00135, 0.5, 0.99865], *parameters)
    assert distribution(fit).ppf([0.00135, 0.5, 0.99865]) == pytest.approx(limits, rel=5e-3)


def test_what_rounding_changes_is_said() -> None:
    """To whoever compares with a program that fits rounded values as they are."""
    x = np.random.default_rng(2).normal(10, 1, 200)
    said = [" ".join(fit_families(values, names=["normal"]).notes) for values in (x, np.round(x, 1))]
    assert ["rounded values" in text for text in said] == [False, True]


def test_figures_of_merit_are_scipys() -> None:
    x = np.random.default_rng(1).normal(10, 2, 400)
    fit = fit_families(x, names=["normal"]).of("normal")
    found = distribution(fit)
    assert fit.distance == pytest.approx(stats.kstest(x, found.cdf).statistic, rel=1e-9)
    assert fit.loglik == pytest.approx(stats.norm.logpdf(x, x.mean(), x.std(ddof=1)).sum(), rel=1e-12)
    assert fit.ad == pytest.approx(stats.anderson(x, method="interpolate").statistic, rel=1e-9)


def test_box_cox_finds_scipys_power() -> None:
    x = np.random.default_rng(5).gamma(4.0, size=400)
    fit = fit_families(x, names=["box_cox"]).of("box_cox")
    assert fit.parameters["lambda"] == pytest.approx(stats.boxcox(x)[1], abs=1e-4)


def test_yeo_johnson_finds_scipys_power_of_the_standardised_values() -> None:
    x = 50 + np.random.default_rng(5).gumbel(size=400)
    fit = fit_families(x, names=["yeo_johnson"]).of("yeo_johnson")
    assert fit.parameters["lambda"] == pytest.approx(stats.yeojohnson((x - fit.shift) / fit.scale)[1], abs=1e-4)


@pytest.mark.slow
@each(
    ("name", "x"),
    [
        ("normal", RNG.normal(13.66, 0.478, 4000)),
        ("lognormal", RNG.lognormal(1, 0.4, 4000)),
        ("weibull", 3 * RNG.weibull(1.6, 4000)),
        ("gamma", RNG.gamma(2.0, size=4000)),
        ("half_normal", np.abs(RNG.normal(size=4000))),
        ("logistic", RNG.logistic(size=4000)),
        ("largest_extreme", RNG.gumbel(size=4000)),
        ("smallest_extreme", -RNG.gumbel(size=4000)),
        ("two_normals", np.concatenate((RNG.normal(0, 1, 1500), RNG.normal(6, 1, 2500)))),
    ],
)
def test_the_family_of_the_draw_is_the_one_chosen(name: str, x) -> None:
    found = fit_families(x)
    assert found.best == name
    assert found.of(name).distance < 0.03
    assert [fit.aic for fit in found.fits] == sorted(fit.aic for fit in found.fits)


def test_errors_of_the_parameters_are_those_of_many_samples() -> None:
    """Standard deviation of the fitted log shape over 300 samples of 200; its own error is 4 %."""
    draws = np.random.default_rng(3).weibull(2, size=(300, 200))
    fits = [fit_families(x, names=["weibull"]).of("weibull") for x in draws]
    spread = np.std([fit.theta[0] for fit in fits])
    said = np.mean([np.sqrt(fit.covariance[0][0]) for fit in fits])
    assert said == pytest.approx(spread, rel=0.13)


def test_a_binned_sample_is_the_sample() -> None:
    """Total weight, mean, distance and Anderson-Darling of 100,000 values, at a fiftieth of them."""
    x = np.sort(np.random.default_rng(2).gamma(3.0, size=100_000))
    whole, part = bin_sample(x, x.size), bin_sample(x, 2000)
    assert (part.values.size, part.weights.sum()) == (2000, 100_000)
    assert part.mean(part.values) == pytest.approx(x.mean(), rel=1e-12)
    assert np.array_equal(part.values[:500], x[:500])
    assert np.array_equal(part.values[-500:], x[-500:])
    known = stats.norm(x.mean(), x.std())
    far = [distance(c, known.cdf(c.values)) for c in (whole, part)]
    crooked = [anderson_darling(c, known.cdf(c.values), known.sf(c.values)) for c in (whole, part)]
    assert far[1] == pytest.approx(far[0], abs=1e-4)
    assert crooked[1] == pytest.approx(crooked[0], rel=1e-3)


@given(st.sampled_from([1e-6, 1.0, 1e6]), st.floats(-1e3, 1e3))
@settings(max_examples=10, deadline=None)
def test_fits_do_not_depend_on_the_unit(scale: float, shift: float) -> None:
    x = np.random.default_rng(8).normal(size=200) ** 3
    for name in ("normal", "johnson_su", "yeo_johnson", "logistic"):
        one = fit_families(x, names=[name]).of(name)
        other = fit_families(scale * (x + shift), names=[name]).of(name)
        assert other.loglik == pytest.approx(one.loglik - 200 * np.log(scale), abs=1e-3)
        assert other.distance == pytest.approx(one.distance, abs=1e-5)


def test_what_cannot_be_fitted_says_why() -> None:
    found = fit_families([-1.0, *np.linspace(1, 2, 30)])
    assert "at or below 0" in found.refused["weibull"]
    assert "too few for 5" in found.refused["two_normals"]
    assert "sigma away" in fit_families(1e6 + np.linspace(0, 1, 30)).refused["gamma"]


@each(
    "x",
    [
        [],
        [1.0],
        [2.0] * 50,
        [np.nan] * 50,
        [1.0, 2.0, 3.0],
        [0.1] * 49 + [0.2],
        [1e200, -1e200] * 20,
        1e120 * np.random.default_rng(1).normal(size=100),
        1e-200 * np.arange(100.0),
    ],
)
def test_odd_values_give_no_error(x) -> None:
    found = fit_families(x)
    assert found.best is None or found.of(found.best) is not None
    assert found.fits or found.notes or found.refused
    for fit in found.fits:
        assert np.all(np.isfinite([fit.loglik, fit.aic, fit.bic, fit.distance, *fit.theta]))


def test_a_million_values_are_fitted_by_a_few_that_stand_for_them() -> None:
    """All families in seconds instead of minutes, with the parameters of the whole."""
    x = np.random.default_rng(7).gamma(30.0, size=1_000_000)
    found = fit_families(x)
    assert found.best == "gamma"
    assert f"{SEARCHED} weighted values" in found.notes[0]
    assert found.of("gamma").parameters["shape"] == pytest.approx(30.0, rel=0.01)
    assert JUDGED > SEARCHED
