"""The gate: true families pass as often as stated, wrong ones and contradicted tails do not."""

import numpy as np
import pytest
from scipy import stats

from reporting.shape.fitting import fit_families


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "draw"),
    [
        ("normal", lambda rng, n: rng.normal(5, 2, n)),
        ("gamma", lambda rng, n: rng.gamma(3.0, size=n)),
        ("largest_extreme", lambda rng, n: rng.gumbel(size=n)),
        ("student_t", lambda rng, n: rng.standard_t(4, n)),
        ("johnson_su", lambda rng, n: np.sinh(rng.normal(0.5, 0.7, n))),
        ("johnson_sl", lambda rng, n: 20 + rng.lognormal(0, 0.6, n)),
    ],
)
def test_p_is_below_one_in_twenty_of_true_families_once_in_twenty(name: str, draw) -> None:
    """100 samples of 60; three binomial standard errors are 0.065."""
    rng = np.random.default_rng(9)
    fits = [fit_families(draw(rng, 60), names=[name]).of(name) for _ in range(100)]
    assert np.mean([fit is not None and fit.ad_p < 0.05 for fit in fits]) <= 0.05 + 0.065


def test_the_p_value_is_that_of_a_bootstrap_with_whole_fits() -> None:
    """Of the normal family: scipy's Monte Carlo, which fits each of its samples anew."""
    x = np.random.default_rng(14).gamma(40.0, size=300)
    fit = fit_families(x, names=["normal"]).of("normal")
    known = stats.goodness_of_fit(stats.norm, x, statistic="ad", n_mc_samples=999, rng=np.random.default_rng(1))
    assert fit.ad == pytest.approx(known.statistic, rel=1e-6)
    assert 0.01 < known.pvalue < 0.5
    assert fit.ad_p == pytest.approx(known.pvalue, abs=0.05)


@pytest.mark.parametrize(
    ("name", "x"),
    [
        ("normal", np.random.default_rng(1).standard_t(5, 500)),
        ("normal", np.random.default_rng(1).random(500)),
        ("logistic", np.random.default_rng(1).gumbel(size=500)),
        ("two_normals", np.random.default_rng(1).random(2000)),
    ],
)
def test_a_wrong_family_fails_and_says_so(name: str, x) -> None:
    found = fit_families(x, names=[name])
    fit = found.of(name)
    assert not fit.passes
    assert fit.ad_p < 0.01
    assert "Anderson-Darling" in fit.misfit
    assert found.best is None
    assert any("No family is used" in note for note in found.notes)


def test_a_tail_that_the_count_contradicts_fails() -> None:
    """27 values of 30,000 beyond a limit where the normal distribution expects 0.1: the body is normal."""
    rng = np.random.default_rng(2)
    x = np.concatenate((rng.normal(size=29_973), rng.uniform(4.6, 5.0, 27)))
    assert fit_families(x, names=["normal"]).best == "normal"
    fit = fit_families(x, names=["normal"], limits=(None, 4.5)).of("normal")
    assert not fit.passes
    assert fit.misfit.startswith("above the upper limit it expects 0.1")
    assert "there are 27" in fit.misfit


def test_a_misfit_of_no_importance_passes_at_a_million_values() -> None:
    """Distance 0.003 of a million: proven by any test, and of no use to know."""
    x = np.random.default_rng(3).gamma(4000.0, size=1_000_000)
    fit = fit_families(x, names=["normal"], limits=(3700.0, 4300.0)).of("normal")
    assert fit.distance < 0.005
    assert fit.ad > 5  # p < 1e-10 as a test of all values
    assert fit.passes


def test_a_product_gives_no_family_at_30_000() -> None:
    """Johnson's SU gave 3,920 ppm where 833 were counted."""
    z = np.random.default_rng(4).normal(size=(3, 30_000))
    found = fit_families(z[0] * z[1] + 0.2 * z[2], limits=(-6.0, 6.0))
    assert found.best is None
    assert not found.of("johnson_su").passes
