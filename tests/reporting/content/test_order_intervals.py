"""Distribution-free tolerance intervals against published sample sizes, and by simulation."""

import numpy as np
import pytest

from reporting.content.order_intervals import (
    confidence_of_blocks,
    fewest_runs,
    most_blocks,
    one_sided_order_limit,
    two_sided_order_interval,
)


@pytest.mark.parametrize(
    ("content", "confidence", "runs"),
    [
        (0.90, 0.95, (29, 46)),
        (0.95, 0.95, (59, 93)),
        (0.99, 0.95, (299, 473)),
        (0.9973, 0.95, (1109, 1756)),
        (0.90, 0.99, (44, 64)),
        (0.95, 0.90, (45, 77)),
    ],
)
def test_wilks_sample_sizes(content, confidence, runs):
    """Published: Wilks 1941; Conover 1999, tables A5 and A6; Hahn and Meeker 1991."""
    assert tuple(fewest_runs(content, confidence, blocks) for blocks in (1, 2)) == runs
    for blocks, n in zip((1, 2), runs, strict=True):
        assert confidence_of_blocks(blocks, n, content) >= confidence > confidence_of_blocks(blocks, n - 1, content)
        assert most_blocks(n, content, confidence) == blocks
        assert most_blocks(n - 1, content, confidence) == blocks - 1


def test_order_two_takes_more_runs():
    """Each value beyond the limit is one more block: second largest of 93, third of 124 (ASME; USNRC guidance)."""
    assert [fewest_runs(0.95, 0.95, blocks) for blocks in (1, 2, 3, 4)] == [59, 93, 124, 153]


def test_limits_are_the_values_at_their_ranks():
    """Two blocks: from the smallest value to the largest; five: two below and three above."""
    x = np.arange(1.0, 201.0)
    assert two_sided_order_interval(x, 1) is None
    assert two_sided_order_interval(x, 2) == (1.0, 200.0)
    assert two_sided_order_interval(x, 5) == (2.0, 198.0)
    assert one_sided_order_limit(x, 0, upper=True) is None
    assert one_sided_order_limit(x, 1, upper=True) == 200.0
    assert one_sided_order_limit(x, 3, upper=False) == 3.0


def test_fewer_effective_values_leave_out_less():
    """An effect of 4 on 1,000 values leaves at most what 250 values leave, four times."""
    assert most_blocks(1000, 0.95, 0.95) == 39
    assert most_blocks(1000, 0.95, 0.95, 4.0) - 1 <= 4 * (most_blocks(250, 0.95, 0.95) - 1) + 4
    assert most_blocks(1000, 0.95, 0.95, 1000 / 58) == 0


def test_every_distribution_is_covered():
    """2,000 samples of 400 values of a jumpy distribution with ties: the content is reached in at least 94 %."""
    rng = np.random.default_rng(4)
    x = np.sort(np.floor(3 * rng.exponential(size=(2000, 400))), axis=1)
    blocks = most_blocks(400, 0.95, 0.95)
    low, high = np.array([two_sided_order_interval(row, blocks) for row in x]).T
    content = np.exp(-low / 3) - np.exp(-(high + 1) / 3)
    assert np.mean(content >= 0.95) >= 0.94
