"""Non-normal indices against published vectors."""

import numpy as np
import pytest
from scipy import stats

from reporting import capability
from reporting.shape.fitting import fit_families
from reporting.shape.nonnormal import ENDS, FEWEST, empirical_indices, empirical_percentiles, fitted_indices

SET_A = 10 + 0.5 * stats.norm.ppf((np.arange(1, 51) - 0.5) / 50)
SET_B = np.exp(1.9 + 0.25 * stats.norm.ppf((np.arange(1, 61) - 0.5) / 60))


def test_set_b_gives_the_published_percentile_method() -> None:
    c = fitted_indices("percentile", fit_families(SET_B).of("lognormal"), 3, 12)
    assert c.percentiles == pytest.approx((3.163412767391, 6.685894442279, 14.13068346758), rel=1e-11)
    assert c.pp == pytest.approx(0.8206234938513, rel=1e-11)
    assert c.ppl == pytest.approx(1.046391374739, rel=1e-11)
    assert c.ppu == pytest.approx(0.7138020351769, rel=1e-11)
    assert c.ppk == c.ppu
    assert c.ppm_expected_below == pytest.approx(657.696446601, rel=1e-9)
    assert c.ppm_expected_above == pytest.approx(9519.368217638, rel=1e-9)


def test_set_b_gives_the_published_z_scores() -> None:
    c = fitted_indices("z_score", fit_families(SET_B).of("lognormal"), 3, 12)
    assert c.ppl == pytest.approx(1.070866708866, rel=1e-11)
    assert c.ppu == pytest.approx(0.7815905462427, rel=1e-11)
    assert c.z_bench == pytest.approx(-stats.norm.ppf(c.ppm_expected * 1e-6), rel=1e-10)


def test_set_b_needs_the_logarithm_by_box_cox() -> None:
    fit = fit_families(SET_B).of("box_cox")
    assert fit.parameters["lambda"] == pytest.approx(0.0, abs=2e-5)
    c = fitted_indices("z_score", fit, 3, 12)
    logs = np.log(SET_B)
    assert c.ppu == pytest.approx((np.log(12) - logs.mean()) / (3 * logs.std()), rel=1e-4)


def test_a_normal_fit_gives_the_usual_indices_by_both_methods() -> None:
    fit, c = fit_families(SET_A).of("normal"), capability(SET_A, 8.2, 11.5)
    for found in (fitted_indices("percentile", fit, 8.2, 11.5), fitted_indices("z_score", fit, 8.2, 11.5)):
        assert found.pp == pytest.approx(c.cp, rel=1e-5)  # 0.135 % is 2.99998 sigma
        assert found.ppk == pytest.approx(c.cpk, rel=1e-5)
        assert found.ppm_expected == pytest.approx(c.ppm_expected, rel=1e-9)


def test_empirical_percentiles_are_rs_type_6() -> None:
    published = (8.83682606298, 10, 11.16317393702)
    assert empirical_percentiles(SET_A, ENDS) == pytest.approx(published, abs=1e-11)
    x = np.sort(np.random.default_rng(1).normal(size=5000))
    assert empirical_percentiles(x, ENDS) == pytest.approx(np.quantile(x, ENDS, method="weibull"), rel=1e-12)


def test_few_values_have_no_empirical_interval_and_say_so() -> None:
    c = empirical_indices(SET_A, 8.2, 11.5)
    assert c.pp == pytest.approx(3.3 / (11.16317393702 - 8.83682606298), rel=1e-9)
    assert c.pp_interval is None
    assert any("percentiles are the extremes" in note for note in c.notes)
    assert 1 - 2 * 0.99865**FEWEST > 0.95 - 1e-3  # both ends of a percentile's interval are in the sample


def test_the_same_values_give_the_same_interval_in_any_order() -> None:
    x = np.random.default_rng(4).normal(size=5000)
    assert empirical_indices(x, -4, 4) == empirical_indices(x[::-1], -4, 4)


@pytest.mark.parametrize("x", [[], [1.0], [1.0] * 5000, [np.nan] * 3, np.r_[np.zeros(4000), 1.0], [1e300, -1e300]])
def test_odd_values_give_no_error(x) -> None:
    c = empirical_indices(x, 0.0, 2.0)
    numbers = [v for v in vars(c).values() if isinstance(v, float)]
    assert np.all(np.isfinite(numbers))
    assert c.notes or c.ppk is not None


def test_a_limit_beyond_the_support_has_no_z_score() -> None:
    c = fitted_indices("z_score", fit_families(SET_B).of("lognormal"), -1.0, 12.0)
    assert c.z_lsl is None
    assert c.ppl is None
    assert c.ppm_expected_below == 0
    assert any("no Z-score" in note for note in c.notes)
