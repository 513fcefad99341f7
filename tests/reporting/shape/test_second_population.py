"""What few values cannot exclude: the share of a second population follows from the binomial distribution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from reporting.shape.estimates import LEAST, MOST, second_population
from studies.coverage.productions import SHAPES, page
from studies.coverage.shapes import truth


def test_the_share_is_the_largest_that_the_values_leave_unseen_once_in_twenty() -> None:
    """1,000 values between -3 and 3 sigmas: a population five times as wide has 55 % of its parts outside."""
    x = norm.ppf((np.arange(1000) + 0.5) / 1000)
    x = x / x.std()
    found = second_population(x, -12.0, 12.0, x.size)
    outside = 2 * norm.cdf(x.min() / 5)
    share = -np.log(0.05) / (1000 * outside)
    assert (1 - share * outside) ** 1000 == pytest.approx(0.05, rel=0.01)
    assert found.ppm == pytest.approx(1e6 * share * norm.sf(12 / 5), rel=1e-6)
    assert "5 times as wide" in found.words


def test_many_values_exclude_every_population_that_is_considered() -> None:
    x = np.random.default_rng(0).normal(size=20_000)
    assert second_population(x, -6.0, 6.0, x.size).ppm == 0.0
    few = second_population(x[:30], -6.0, 6.0, 30)
    assert few.ppm <= 1e6 * MOST
    assert second_population(x[:1000], -6.0, 6.0, 1000).ppm >= 1e6 * LEAST * norm.sf(6 / 5)
    assert second_population(np.full(50, 3.0), 0.0, 6.0, 50) is None


def test_values_in_lots_exclude_less() -> None:
    x = np.random.default_rng(1).normal(size=2_000)
    assert second_population(x, -6.0, 6.0, 200.0).ppm > second_population(x, -6.0, 6.0, 2_000.0).ppm


def test_the_page_says_what_is_not_ruled_out_whatever_the_values_look_like() -> None:
    """The 0.3 % that are five times as wide are in one sample of 500 and not in the next; the limit is at 159 ppm."""
    rng = np.random.default_rng(2)
    for _ in range(4):
        y = rng.normal(size=500) * np.where(rng.random(500) < 0.003, 5, 1)
        (found,) = page(SHAPES[0], y, replace(truth("normal"), lsl=-8.08, usl=8.08)).responses
        assert any("500 values do not rule out" in note for note in found.fits.notes)
    (found,) = page(SHAPES[0], rng.normal(size=20_000), replace(truth("normal"), lsl=-6.0, usl=6.0)).responses
    assert not any("do not rule out" in note for note in found.fits.notes)
