"""Sigma within batches against published numbers and constants, R, a simulation and the analysis of variance."""

import math

import numpy as np
import pytest
from scipy import stats

from reporting import ReportError, capability
from reporting.capability.indices import NAMES, WHICH_SIGMA
from reporting.capability.interval_choice import freedom_of_pooled
from reporting.capability.intervals import cpk_interval
from reporting.capability.within import c4, d2, d3, subgroup_sigmas, within


def set_c() -> tuple[np.ndarray, np.ndarray]:
    """Return 12 batches of 5 that drift."""
    rows = [
        (20 + 0.1 * ((7 * i) % 11) + 0.05 * ((3 * i * j) % 7) + 0.02 * i, i) for i in range(1, 13) for j in range(1, 6)
    ]
    values, batches = zip(*rows, strict=True)
    return np.array(values), np.array(batches)


def test_set_c_gives_the_published_pooled_sigma() -> None:
    """The drift makes the sigma within 3.5 times as small as the overall one, and so the indices."""
    x, batches = set_c()
    c = capability(x, 19.5, 21.7, batches=batches)
    assert c.within.std == pytest.approx(0.0886237364743, rel=1e-11)
    assert (c.within.batches, c.within.nu) == (12, 48)
    assert c.std == pytest.approx(0.3134102562147, rel=1e-12)
    assert c.within.cp == pytest.approx(2.2 / (6 * 0.0886237364743), rel=1e-11)
    assert c.within.cpk == pytest.approx(c.cpk * c.std / c.within.std, rel=1e-12)
    low, high = c.within.cp_interval
    assert low / c.within.cp == pytest.approx(np.sqrt(stats.chi2.ppf(0.025, 48) / 48), rel=1e-12)
    assert high / c.within.cp == pytest.approx(np.sqrt(stats.chi2.ppf(0.975, 48) / 48), rel=1e-12)


def test_the_sigma_between_is_that_of_the_analysis_of_variance() -> None:
    x, batches = set_c()
    groups = [x[batches == i] for i in range(1, 13)]
    f = stats.f_oneway(*groups).statistic
    c = capability(x, batches=batches)
    assert c.within.std_between == pytest.approx(c.within.std * np.sqrt((f - 1) / 5), rel=1e-10)


@pytest.mark.slow
def test_intervals_within_cover_the_truth() -> None:
    """1,500 campaigns of 12 batches of 5 that agree; three binomial standard errors are 0.017, Bissell one percent."""
    batches = np.repeat(np.arange(12), 5)
    inside = {"cp": 0, "cpk": 0, "cpl": 0, "cpu": 0}
    truth = {"cp": 1.33, "cpk": 1.0, "cpl": 1.0, "cpu": 1.66}
    for x in np.random.default_rng(9).normal(size=(1500, 60)):
        found = capability(x, -3.0, 4.98, batches=batches).within
        for name in inside:
            low, high = getattr(found, f"{name}_interval")
            inside[name] += low <= truth[name] <= high
    for name, count in inside.items():
        assert count / 1500 == pytest.approx(0.95, abs=0.027 if name == "cpk" else 0.017), name


def test_one_batch_is_the_overall_sigma() -> None:
    x, _ = set_c()
    c = capability(x, 19.5, 21.7, batches=np.full(60, "A7"))
    assert c.within.std == pytest.approx(c.std, rel=1e-12)
    assert c.within.std_between is None
    alone = capability(x, 19.5, 21.7)
    assert c.within.cpk_interval == pytest.approx(cpk_interval(alone.cpk, 60, 0.95), rel=1e-12)


def test_batches_do_not_depend_on_order_offset_or_names() -> None:
    x, batches = set_c()
    order = np.random.default_rng(1).permutation(60)
    one = capability(x, 19.5, 21.7, batches=batches).within
    other = capability(x[order] + 1e6, 19.5 + 1e6, 21.7 + 1e6, batches=[f"lot {b}" for b in batches[order]]).within
    assert other.std == pytest.approx(one.std, rel=1e-7)
    assert other.cpk == pytest.approx(one.cpk, rel=1e-7)


def test_values_that_are_missing_take_their_batch_along() -> None:
    x, batches = set_c()
    holes = np.where(batches == 3, np.nan, x)
    kept = batches != 3
    assert capability(holes, batches=batches).within == capability(x[kept], batches=batches[kept]).within


def test_no_batch_with_a_spread_has_no_sigma_within() -> None:
    c = capability([1.0, 2.0, 3.0], 0, 4, batches=[1, 2, 3])
    assert c.within is None
    assert any("No batch has two different values" in note for note in c.notes)
    assert capability([1.0, 1.0, 3.0, 3.0], 0, 4, batches=[1, 1, 2, 2]).within is None


def test_batches_must_be_as_many_as_the_values() -> None:
    with pytest.raises(ReportError, match=r"\b3 values"):
        capability([1.0, 2.0, 3.0], batches=[1, 2])


def test_every_index_has_its_names() -> None:
    """The paper's Cp is AIAG's Pp; which sigma is one sentence, said once."""
    assert (NAMES["cp"].paper, NAMES["cp"].overall, NAMES["cp"].within) == ("Cp", "Pp", "Cp")
    assert (NAMES["cpk"].paper, NAMES["cpk"].overall, NAMES["cpk"].within) == ("Cpk", "Ppk", "Cpk")
    assert "overall" in WHICH_SIGMA


def covered(draw, cp: float, times: int = 300) -> float:
    """Return how often the interval of Cp within 20 lots of 25 holds the truth."""
    rng, batches = np.random.default_rng(14), np.repeat(np.arange(20), 25)
    hits = 0
    for _ in range(times):
        low, high = within(draw(rng, batches), batches, -3.0, 3.0, 0.95).cp_interval
        hits += low <= cp <= high
    return hits / times


def test_intervals_hold_where_lots_differ_in_spread() -> None:
    """Lots of which each has a sigma of its own: chi-square with the freedom of all values covers half of them."""
    scale = 0.6

    def draw(rng, batches):
        return (np.exp(scale * rng.standard_normal(20))[:, None] * rng.standard_normal((20, 25))).ravel()

    assert covered(draw, 1 / np.exp(scale**2)) >= 0.85


def test_intervals_hold_where_values_within_lots_have_heavy_tails() -> None:
    def draw(rng, batches):
        return rng.standard_t(5, 500) / np.sqrt(5 / 3)

    assert covered(draw, 1.0) >= 0.91


@pytest.mark.slow
@pytest.mark.parametrize(("lots", "size"), [(20, 3), (10, 5), (5, 100)])
def test_intervals_hold_for_a_skewed_response(lots, size) -> None:
    """The residuals of small lots look more normal than the values, and five lots tell little of how lots differ."""
    rng, batches, hits = np.random.default_rng(14), np.repeat(np.arange(lots), size), 0
    # Of exp(s w), where half the variance of the normal score w lies between lots.
    inside = np.exp(0.5) - np.exp(0.375)
    for _ in range(400):
        score = rng.standard_normal(lots)[batches] + rng.standard_normal(lots * size)
        low, high = within(np.exp(0.5 * score / 2**0.5) / inside**0.5, batches, -3.0, 3.0, 0.95).cp_interval
        hits += low <= 1.0 <= high
    assert hits / 400 >= 0.9


def test_normal_values_within_lots_keep_their_interval() -> None:
    """Exact, but where chance makes a sample look otherwise, which widens it."""

    def draw(rng, batches):
        return rng.standard_normal(500) + rng.standard_normal(20)[batches]

    assert 0.92 <= covered(draw, 1.0) <= 0.985


def test_a_confidence_of_next_to_nothing_has_degrees_of_freedom_too():
    """Both quantiles behind them round to 0 there; their ratio has a limit."""
    values = np.random.default_rng(0).normal(size=41)
    values -= values.mean()
    small, least = (freedom_of_pooled(values, np.zeros(41, int), confidence) for confidence in (1e-6, 1e-160))
    assert small == least
    assert 1 < least < 40


# Montgomery, Introduction to Statistical Quality Control, appendix VI; AIAG SPC: n = 2 to 25.
D2 = (1.128, 1.693, 2.059, 2.326, 2.534, 2.704, 2.847, 2.970, 3.078, 3.173, 3.258, 3.336, 3.407, 3.472, 3.532, 3.588,
      3.640, 3.689, 3.735, 3.778, 3.819, 3.858, 3.895, 3.931)  # fmt: skip
D3 = (0.853, 0.888, 0.880, 0.864, 0.848, 0.833, 0.820, 0.808, 0.797, 0.787, 0.778, 0.770, 0.763, 0.756, 0.750, 0.744,
      0.739, 0.734, 0.729, 0.724, 0.720, 0.716, 0.712, 0.708)  # fmt: skip
C4 = (0.7979, 0.8862, 0.9213, 0.9400, 0.9515, 0.9594, 0.9650, 0.9693, 0.9727, 0.9754, 0.9776, 0.9794, 0.9810, 0.9823,
      0.9835, 0.9845, 0.9854, 0.9862, 0.9869, 0.9876, 0.9882, 0.9887, 0.9892, 0.9896)  # fmt: skip


def test_constants_are_the_published_ones():
    """To the last digit (d3 of 19 is 0.7335, printed 0.734), and exactly for two values."""
    sizes = range(2, 26)
    assert [d2(n) for n in sizes] == pytest.approx(D2, abs=5.1e-4)
    assert [d3(n) for n in sizes] == pytest.approx(D3, abs=6e-4)
    assert [c4(n) for n in sizes] == pytest.approx(C4, abs=5.1e-5)
    assert (d2(2), d3(2)) == pytest.approx((2 / math.sqrt(math.pi), math.sqrt(2 - 4 / math.pi)), rel=1e-12)
    assert c4(100_000) == pytest.approx(1 - 1 / 400_000, abs=1e-9)


def subgroups_of_five():
    """Return twelve subgroups of five with a strong drift, and their numbers."""
    i, j = np.repeat(np.arange(1, 13), 5), np.tile(np.arange(1, 6), 12)
    return 20 + 0.1 * ((7 * i) % 11) + 0.05 * ((3 * i * j) % 7) + 0.02 * i, i


def test_equal_batches_are_qccs():
    """R's qcc: R-bar 0.2125 over d2 (2.326 there), S-bar / c4 0.08971609638974, Cp 4.01349, Cpk 3.25944."""
    ranges, sigmas = subgroup_sigmas(*subgroups_of_five(), 19.5, 21.7)
    assert (ranges.method, ranges.batches) == ("R-bar / d2", 12)
    assert ranges.std == pytest.approx(0.2125 / d2(5), rel=1e-12)
    assert ranges.std == pytest.approx(0.09135855546002, rel=5e-5)
    assert (ranges.cp, ranges.cpk) == pytest.approx((4.013490196078, 3.259440522876), rel=5e-5)
    assert sigmas.std == pytest.approx(0.08971609638974, rel=1e-10)


def test_unequal_batches_are_weighted_by_their_precision():
    """Minitab's formulas, by hand: batches of 2, 3 and 5; one of a single value counts for nothing."""
    x = np.array([1.0, 2.0, 4.0, 5.0, 7.0, 1.0, 2.0, 3.0, 4.0, 8.0, 99.0])
    batches = np.array([0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 3])
    ranges, sigmas = subgroup_sigmas(x, batches, None, 100.0)
    f = [(d2(n) / d3(n)) ** 2 for n in (2, 3, 5)]
    assert ranges.std == pytest.approx(
        sum(w * r / d2(n) for w, r, n in zip(f, (1, 3, 7), (2, 3, 5), strict=True)) / sum(f)
    )
    h = [c4(n) ** 2 / (1 - c4(n) ** 2) for n in (2, 3, 5)]
    s = [math.sqrt(0.5), np.std([4, 5, 7], ddof=1), np.std([1, 2, 3, 4, 8], ddof=1)]
    assert sigmas.std == pytest.approx(
        sum(w * each / c4(n) for w, each, n in zip(h, s, (2, 3, 5), strict=True)) / sum(h)
    )
    assert (ranges.batches, ranges.cp) == (3, None)
    assert ranges.cpk == pytest.approx((100 - x.mean()) / (3 * ranges.std))
    shuffled = np.random.default_rng(1).permutation(x.size)
    assert subgroup_sigmas(x[shuffled], batches[shuffled], None, 100.0)[1].std == pytest.approx(sigmas.std)


def test_both_estimate_sigma_within_without_bias():
    """5,000 batches of 4 with shifts of three sigma: both find 1 to 1 %; batches of 26 have no ranges."""
    rng = np.random.default_rng(2)
    x = (rng.normal(size=(5000, 4)) + 3 * rng.normal(size=(5000, 1))).ravel()
    assert [s.std for s in subgroup_sigmas(x, np.arange(x.size) // 4, None, None)] == pytest.approx([1, 1], rel=0.02)
    assert [s.method for s in subgroup_sigmas(x, np.arange(x.size) // 26, None, None)] == ["S-bar / c4"]


@pytest.mark.parametrize(
    ("x", "batches"),
    [([], []), ([1.0, 2.0], [0, 1]), ([1.0, 1.0, 2.0, 2.0], [0, 0, 1, 1]), ([0.0, 0.0, 0.0, 0.0], [0, 0, 1, 1])],
)
def test_without_spread_in_a_batch_there_is_none(x, batches):
    """Nor without a batch of two values."""
    assert subgroup_sigmas(np.array(x), np.array(batches), 0.0, 3.0) == ()


@pytest.mark.parametrize("scale", [3e307, 1e200, 1e-300])
def test_values_of_absurd_size_do_not_overflow(scale):
    """Ranges have no squares: their sigma may be given; the sigma of values that cannot be squared is not."""
    x = scale * np.random.default_rng(1).uniform(-1, 1, 40)
    found = subgroup_sigmas(x, np.arange(40) // 4, -1.0, 1.0)
    assert all(math.isfinite(s.std) and s.std > 0 for s in found)
    assert scale == 3e307 or found[0].method == "R-bar / d2"
