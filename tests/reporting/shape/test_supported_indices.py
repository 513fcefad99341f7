"""Non-normal indices with intervals over all families that the values allow: agreement, range and coverage."""

import numpy as np
import pytest
from scipy import stats

from reporting import capability
from reporting.capability.intervals import cpk_interval, with_ends
from reporting.shape.fitting import AIC_SUPPORT, fit_families
from reporting.shape.nonnormal import ENDS, fitted_indices
from reporting.shape.supported_indices import supported_indices


def test_the_interval_of_the_normal_family_alone_is_that_of_cpk() -> None:
    """Bissell's at the same bar of the likelihood."""
    x = np.random.default_rng(1).normal(10, 0.5, 300)
    bar = 2 * stats.norm.cdf(np.sqrt(AIC_SUPPORT)) - 1
    known = capability(x, 8.2, 11.5)
    for found in supported_indices(x, fit_families(x, names=["normal"]), 8.2, 11.5):
        assert found.ppk == pytest.approx(known.cpk, rel=1e-5)
        assert found.ppk_interval == pytest.approx(cpk_interval(known.cpk, 300, bar), abs=0.015)
        assert found.ppl_interval == pytest.approx(cpk_interval(known.cpl, 300, bar), abs=0.015)
        assert found.ppm_range is None


def test_families_that_disagree_give_a_range() -> None:
    """500 t-distributed values do not tell logistic from Student t, which differ by a factor of ten beyond a limit."""
    x = np.random.default_rng(12).standard_t(5, 500)
    fits = fit_families(x, limits=(-9.0, 9.0))
    _, found = supported_indices(x, fits, -9.0, 9.0)
    each = [fitted_indices("z_score", fits.of(name), -9.0, 9.0).ppm_expected for name in fits.candidates]
    assert len(each) >= 2
    assert max(each) > 3 * min(each)
    assert found.ppm_range == (min(each), max(each))
    assert found.candidates == tuple(fits.of(name).title for name in fits.candidates)
    assert found.ppm_expected_interval[0] <= min(each)
    assert found.ppm_expected_interval[1] >= max(each)


def test_a_family_that_nothing_else_contests_gives_one_number() -> None:
    rng = np.random.default_rng(1)
    x = np.where(rng.random(800) < 0.5, rng.normal(-2, 1, 800), rng.normal(2, 0.7, 800))
    _, found = supported_indices(x, fit_families(x, limits=(None, 4.0)), None, 4.0)
    assert (found.family, found.candidates) == ("two_normals", ("mixture of two normals",))
    assert found.ppm_range is None
    low, high = found.ppm_expected_interval
    assert low < 0.5e6 * stats.norm.sf(2 / 0.7) < high < 10 * low


def test_limits_of_coarsely_rounded_values_may_be_half_a_step_off() -> None:
    """Steps of half a sigma, 5,000 values: the share beyond a limit between two steps, whichever way it was rounded."""
    z = np.random.default_rng(8).normal(size=5000)
    rounded = np.round(z / 0.5) * 0.5
    for limit in (3.3, 3.5, 3.7):
        _, found = supported_indices(rounded, fit_families(rounded, limits=(None, limit)), None, limit)
        low, high = found.ppm_expected_interval
        # the largest step within the limit, and the edge between it and the next
        edge = np.floor(limit / 0.5) * 0.5 + 0.25
        assert low < 1e6 * stats.norm.sf(edge) < high
        assert any("steps of 0.5 sigma" in note for note in found.notes)
    fine = np.round(z / 0.05) * 0.05
    _, found = supported_indices(fine, fit_families(fine, limits=(None, 3.5)), None, 3.5)
    assert not any("sigma:" in note for note in found.notes)


def test_a_large_offset_costs_no_digits() -> None:
    """At mean 1e9 and sigma 1e-3 the interval had no width."""
    z = np.random.default_rng(2).normal(size=400)
    one = supported_indices(z, fit_families(z), -4.0, 4.0)
    far = 1e9 + 1e-3 * z
    limits = 1e9 - 4e-3, 1e9 + 4e-3
    other = supported_indices(far, fit_families(far), *limits)
    for a, b in zip(one, other, strict=True):
        assert b.ppk == pytest.approx(a.ppk, rel=1e-3)
        low, high = with_ends(b.ppk_interval)
        assert high - low > 0.1


def test_without_a_family_there_are_no_indices() -> None:
    x = np.maximum(np.random.default_rng(3).normal(size=400), -1.0)
    assert supported_indices(x, fit_families(x), -4.0, 4.0) == ()


def test_the_same_values_give_the_same_interval_in_any_order() -> None:
    x = np.random.default_rng(4).gamma(4.0, size=300)
    fits = fit_families(x)
    assert supported_indices(x, fits, None, 14.0) == supported_indices(x[::-1], fits, None, 14.0)


def test_an_interval_without_an_upper_end_says_so() -> None:
    """The values allow a distribution that ends before the limit: no number stands in the place of its upper end."""
    x = np.random.default_rng(8).normal(size=100)
    percentile, z_score = supported_indices(x, fit_families(x, limits=(-9.0, 9.0)), -9.0, 9.0)
    assert z_score.family == "normal"
    assert z_score.ppk_interval[1] is None
    assert 1.0 < z_score.ppk_interval[0] < z_score.ppk
    assert any("no upper end" in note for note in z_score.notes)
    assert percentile.ppk_interval[0] < percentile.ppk < percentile.ppk_interval[1]
    assert not any("no upper end" in note for note in percentile.notes)


def test_far_limits_cut_no_interval_by_percentiles() -> None:
    """Earlier all ended at 12.667, below the index itself."""
    x = np.random.default_rng(8).normal(size=400)
    percentile, _ = supported_indices(x, fit_families(x, limits=(-90.0, 90.0)), -90.0, 90.0)
    assert percentile.ppk_interval[0] < percentile.ppk < percentile.ppk_interval[1]
    assert percentile.ppk > 20


def test_values_that_end_abruptly_have_no_largest_z_score() -> None:
    """Normal values cut at 2 sigma: fitted families end smoothly, and covered the Ppk in 12 of 100 samples of 500."""
    known, rng, cut = stats.truncnorm(-2, 2), np.random.default_rng(11), 0
    lsl, usl = known.ppf(stats.norm.sf(3 * 1.17)), known.isf(stats.norm.sf(3 * 1.0))
    for _ in range(4):
        x = known.rvs(500, random_state=rng)
        _, found = supported_indices(x, fit_families(x, limits=(lsl, usl)), lsl, usl)
        for name, truth in (("ppk", 1.0), ("ppl", 1.17), ("ppu", 1.0)):
            low, high = with_ends(getattr(found, f"{name}_interval"))
            assert low <= truth <= high, name
        ends = [with_ends(interval)[1] for interval in (found.ppk_interval, found.ppl_interval, found.ppu_interval)]
        assert ends[0] >= min(ends[1:])  # that of the side that is not cut
        cut += ends.count(np.inf)
        assert any("end abruptly" in note for note in found.notes)
    assert cut >= 9


SHAPES = {
    "lognormal above 20": stats.lognorm(0.5, loc=20),
    "gamma": stats.gamma(16),
    "t5": stats.t(5, loc=50),
    "skewed": stats.skewnorm(4),
}


@pytest.mark.slow
@pytest.mark.parametrize("n", [50, 500])
@pytest.mark.parametrize("shape", SHAPES)
def test_intervals_cover_the_truth_whatever_family_is_chosen(shape: str, n: int) -> None:
    """20 samples. Before, 26 of 100 at 50 and none at 500 on t5. 0.8 is 0.92 less two binomial errors of 0.06."""
    known = SHAPES[shape]
    low, median, high = known.ppf(ENDS)
    lsl, usl = median - 1.3 * (median - low), median + 1.1 * (high - median)
    truths = 1.1, min(-stats.norm.ppf(known.cdf(lsl)), -stats.norm.ppf(known.sf(usl))) / 3
    rng = np.random.default_rng(9)
    inside: list[list[bool]] = [[], []]
    for _ in range(20):
        x = known.ppf(rng.random(n))
        found = supported_indices(x, fit_families(x, limits=(lsl, usl)), lsl, usl)
        for method, truth, held in zip(found, truths, inside, strict=False):
            if method.ppk_interval:  # a best family that ends before the limit has no Z-score
                low_end, high_end = with_ends(method.ppk_interval)
                held.append(low_end <= truth <= high_end)
    for held in inside:
        assert len(held) >= 14
        assert np.mean(held) >= 0.8
