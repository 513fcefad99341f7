"""Factors of normal tolerance intervals against published tables."""

import math

import pytest
from scipy import stats

from reporting.tolerance_intervals import one_sided_factor, two_sided_factor
from tests.each import each

# ISO 16269-6:2014, annex F: factors of m samples of n values each, rounded up. (content, confidence, n, m): k.
ISO_TWO_SIDED = {
    (0.90, 0.90, 2, 1): 15.5124,
    (0.90, 0.90, 100, 1): 1.8232,
    (0.90, 0.90, 2, 10): 2.9565,
    (0.95, 0.90, 3, 1): 6.8233,
    (0.95, 0.90, 30, 4): 2.1870,
    (0.99, 0.90, 4, 1): 6.3722,
    (0.90, 0.95, 2, 1): 31.0923,
    (0.95, 0.95, 5, 1): 5.0769,
    (0.95, 0.95, 10, 1): 3.3935,
    (0.95, 0.95, 26, 1): 2.6188,
    (0.95, 0.95, 90, 1): 2.2519,
    (0.95, 0.95, 200, 1): 2.1430,
    (0.95, 0.95, 1000, 1): 2.0362,
    (0.95, 0.95, 10, 7): 2.4677,
    (0.99, 0.95, 3, 1): 12.6472,
    (0.99, 0.95, 500, 1): 2.7208,
    (0.90, 0.99, 10, 1): 3.6167,
    (0.95, 0.99, 2, 1): 182.7201,
    (0.99, 0.99, 3, 1): 28.5857,
    (0.99, 0.99, 1000, 10): 2.6205,
}
# Hahn and Meeker 1991, table A.12; MIL-HDBK-17 (content 0.90 and 0.99). (content, n): k at confidence 0.95.
ONE_SIDED = {
    (0.95, 2): 26.260,
    (0.95, 3): 7.656,
    (0.95, 5): 4.203,
    (0.95, 10): 2.911,
    (0.95, 20): 2.396,
    (0.95, 50): 2.065,
    (0.95, 100): 1.927,
    (0.90, 5): 3.407,
    (0.90, 10): 2.355,
    (0.99, 10): 3.981,
    (0.99, 30): 3.064,
    (0.99, 100): 2.684,
}


@each(("asked", "k"), ISO_TWO_SIDED.items())
def test_two_sided_factors_are_those_of_iso_16269_6(asked, k):
    """To the last digit of the table, whose numbers are rounded up."""
    content, confidence, n, samples = asked
    found = two_sided_factor(n, content, confidence, samples * (n - 1))
    assert math.ceil(found * 1e4 - 1e-6) / 1e4 == pytest.approx(k, abs=1e-9)


@each(("asked", "k"), ONE_SIDED.items())
def test_one_sided_factors_are_those_of_hahn_and_meeker(asked, k):
    """To the last digit of the table."""
    content, n = asked
    assert one_sided_factor(n, content, 0.95) == pytest.approx(k, abs=5.1e-4)


def test_nists_example():
    """e-Handbook 7.2.6.3, n = 43: one-sided 1.8739536; two-sided by Howe 2.2173, which is 0.25 % short."""
    assert one_sided_factor(43, 0.90, 0.99) == pytest.approx(1.8739536, abs=1e-7)
    assert two_sided_factor(43, 0.90, 0.99) == pytest.approx(2.2173 * 1.0025, rel=1e-4)


@pytest.mark.parametrize("n", [2, 30, 30_000])
def test_large_samples_and_high_contents_stay_exact(n):
    """The content is 6 sigma's: the one-sided factor is scipy's where that returns, the two-sided one is larger."""
    content = 1 - 3.4e-6
    one, two = one_sided_factor(n, content, 0.95), two_sided_factor(n, content, 0.95)
    assert one == pytest.approx(stats.nct.isf(0.05, n - 1, math.sqrt(n) * stats.norm.ppf(content)) / math.sqrt(n), 1e-6)
    assert two > stats.norm.ppf((1 + content) / 2)
    assert one < two < 1.2 * one
