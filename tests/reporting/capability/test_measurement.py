"""The process behind its gauge: how often the interval of its index contains the truth."""

import numpy as np
import pytest

from reporting.capability.measurement import behind_gauge


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
