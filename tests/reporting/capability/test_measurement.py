"""The process behind its gauge: how often the interval of its index contains the truth."""

import numpy as np
import pytest

from reporting.gauge import behind_gauge, conformity


def test_the_variance_of_the_gauge_is_taken_out() -> None:
    x = np.array([-5.0, 5.0] * 50) * np.sqrt(99 / 100)  # standard deviation 5, of which the gauge has 4
    found = behind_gauge(x, -9.0, 9.0, 4.0, None, 0.95, "")
    assert (found.share, found.std, found.cpk) == (pytest.approx(0.64), pytest.approx(3.0), pytest.approx(1.0))
    assert found.of_tolerance == pytest.approx(24 / 18)
    nothing = behind_gauge(x, -9.0, 9.0, 5.0, None, 0.95, "")
    assert (nothing.std, nothing.cpk, nothing.cpk_interval) == (None, None, None)


def test_near_a_limit_nothing_is_proved() -> None:
    """ISO 14253-1, limits 0 and 10, expanded uncertainty 1: proved within 1 to 9, proved not beyond -1 and 11."""
    x = np.array([-1.1, -0.9, 0.5, 1.0, 5.0, 9.0, 9.1, 10.9, 11.1])
    found = conformity(x, 0.0, 10.0, 1.0)
    assert (found.low, found.high) == (1.0, 9.0)
    assert (found.conforming, found.nonconforming, found.undecided) == (3, 2, 4)
    assert conformity(x, None, 10.0, 1.0).conforming == 6


@pytest.mark.slow
@pytest.mark.parametrize("freedom", [None, 20])
def test_the_interval_contains_the_index_of_the_parts(freedom) -> None:
    """Parts of sigma 1, limits at 4, a gauge of 0.4 that is known or estimated: 400 samples of 125."""
    rng, inside = np.random.default_rng(1), 0
    for _ in range(400):
        x = rng.normal(0.5, 1.0, 125) + rng.normal(0.0, 0.4, 125)
        gauge = 0.4 if freedom is None else 0.4 * np.sqrt(rng.chisquare(freedom) / freedom)
        low, high = behind_gauge(x, -4.0, 4.0, gauge, freedom, 0.95, "").cpk_interval
        inside += low <= 3.5 / 3 <= high
    assert 366 <= inside <= 395  # fewer than 366 of 400 at 95 %: 0.002; more than 395: 0.0003
