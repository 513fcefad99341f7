"""Sigma within batches from ranges and sigmas, against the published constants and R's numbers."""

import math

import numpy as np
import pytest

from reporting.capability.subgroup_sigma import c4, d2, d3, subgroup_sigmas

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


@pytest.mark.parametrize(("x", "batches"), [([], []), ([1.0, 2.0], [0, 1]), ([1.0, 1.0, 2.0, 2.0], [0, 0, 1, 1])])
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
