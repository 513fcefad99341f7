"""Bins that hold every value and end at the limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reporting.shape.histogram import histogram

numbers = st.floats(-1e4, 1e4).map(lambda v: round(v, 6))


@given(
    st.lists(numbers, min_size=1, max_size=60),
    st.none() | st.tuples(numbers, st.floats(1e-2, 1e4)).map(lambda p: (p[0], p[0] + p[1])),
    st.sampled_from(["both", "lower", "upper"]),
)
def test_no_value_is_lost_and_no_bar_straddles_a_limit(x, fence, sides) -> None:
    lsl = fence[0] if fence and sides != "upper" else None
    usl = fence[1] if fence and sides != "lower" else None
    data = np.array(x)
    bins = histogram(data, lsl, usl)
    edges, counts = np.array(bins.edges), np.array(bins.counts)
    assert counts.sum() == data.size
    assert np.all(np.diff(edges) > 0)
    assert counts.size <= 200
    if lsl is not None:
        assert counts[edges[1:] <= lsl].sum() == np.count_nonzero(data < lsl)
    if usl is not None:
        assert counts[edges[:-1] > usl].sum() == np.count_nonzero(data > usl)


def test_normal_values_get_a_readable_number_of_bins() -> None:
    x = np.random.default_rng(1).normal(13.6, 0.48, 30_850)
    bins = histogram(x, 9.0, 16.0)
    assert 20 <= len(bins.counts) <= 90
    assert 16.0 not in bins.edges[:-1]


@pytest.mark.parametrize("value", [0.0, 1.5, -3e8, 1e-12])
def test_a_constant_has_one_occupied_bin(value: float) -> None:
    bins = histogram(np.full(7, value), None, None)
    assert [count for count in bins.counts if count] == [7]


def test_no_values_no_histogram() -> None:
    assert histogram(np.array([])) is None


def test_a_constant_is_in_the_middle_of_its_bar() -> None:
    """Not at the left end of a bar of values that do not occur."""
    bins = histogram(np.full(20, 1.0))
    assert bins.counts == (20,)
    assert sum(bins.edges) / 2 == pytest.approx(1.0)
