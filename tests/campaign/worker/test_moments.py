"""Moments of a growing table."""

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from campaign.worker.messages import Moments, add_moments, moments

NUMBERS = st.lists(st.floats(-1e6, 1e6), min_size=0, max_size=30)


def of(x):
    return moments(pa.table({"x": pa.array(x, pa.float64())}), ["x"])["x"]


@settings(deadline=None)
@given(NUMBERS, NUMBERS)
def test_sum_of_two(a, b):
    """Moments of two tables add up to those of both together."""
    both, whole = of(a) + of(b), of(a + b)
    assert both.n == whole.n
    assert both.mean == pytest.approx(whole.mean, abs=1e-9)
    assert both.squares == pytest.approx(whole.squares, rel=1e-9, abs=1e-3)


def test_digits_at_a_large_mean():
    """A spread of one in a hundred million keeps its digits, in a hundred pieces."""
    x = 1e8 + np.random.default_rng(1).normal(size=10_000)
    total = {}
    for piece in np.split(x, 100):
        add_moments(total, {"x": of(piece)})
    assert total["x"].std == pytest.approx(float(np.std(x - 1e8, ddof=1)), rel=1e-6)


def test_failed_runs_do_not_count():
    """A null is no value."""
    assert of([1.0, None, 3.0]) == Moments(2, 2.0, 2.0)


def test_importance_samples_do_not_count():
    """Of weighted rows only those count that are drawn from the distributions: the others are no production."""
    table = pa.table({"x": pa.array([1.0, 90.0, 3.0]), "component": pa.array([0, 1, 0])})
    assert moments(table, ["x"])["x"] == Moments(2, 2.0, 2.0)
