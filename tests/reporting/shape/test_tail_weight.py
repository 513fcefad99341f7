"""The weight of a tail: known distributions, and p-values that are shares of normal samples."""

import numpy as np
import pytest
from scipy import stats

from reporting.shape.condensed import condense
from reporting.shape.tail_weight import tail_weights


def weights(x):
    z = np.sort((x - x.mean()) / x.std(ddof=1))
    return tail_weights(condense(z, 20_000), x.size)


@pytest.mark.parametrize(
    ("known", "below", "above"),
    [
        (stats.norm, "like normal", "like normal"),
        (stats.uniform, "lighter", "lighter"),
        (stats.t(6), "heavier", "heavier"),
        (stats.gamma(16), "lighter", "heavier"),
        (stats.gumbel_l, "heavier", "lighter"),
    ],
)
def test_known_distributions(known, below: str, above: str) -> None:
    low, high = weights(known.ppf((np.arange(4_000) + 0.5) / 4_000))
    assert (low.side, low.word, high.side, high.word) == ("below", below, "above", above)


def test_the_weight_of_a_uniform_tail() -> None:
    """E z^4 is 9/5 for a uniform distribution of variance 1, 3 for a normal one."""
    low, high = weights(np.linspace(-1, 1, 2_001))
    assert (low.weight, high.weight) == pytest.approx((0.6, 0.6), rel=2e-3)


@pytest.mark.parametrize("n", [50, 500])
def test_p_is_a_share_of_normal_samples(n: int) -> None:
    """Of 2,000 normal samples, two tails each; the formula holds to a third at 1 %."""
    p = np.array([[tail.p for tail in weights(x)] for x in np.random.default_rng(n).normal(size=(2_000, n))])
    for level, most in ((0.01, 0.016), (0.05, 0.062), (0.2, 0.23)):
        assert np.mean(p <= level) <= most


def test_few_values_have_no_weight() -> None:
    assert weights(np.arange(49.0)) == ()
