"""Batches by their size: in everything the list of them, at any number of samples."""

from bisect import bisect_left
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaign.batches import Batches, as_rule
from campaign.plan_header import PlanHeader

SIZES = st.integers(1, 400).flatmap(lambda samples: st.tuples(st.just(samples), st.integers(1, samples)))


def listed(samples, size):
    """Return batches as a list of them."""
    return tuple((first, min(size, samples - first)) for first in range(0, samples, size))


@given(SIZES, st.data())
def test_a_rule_is_its_list(sizes, data):
    """Length, order, items and slices from both ends, and nothing beyond."""
    batches, expected = Batches(*sizes), listed(*sizes)
    assert (len(batches), tuple(batches)) == (len(expected), expected)
    ends = st.integers(-len(expected) - 3, len(expected) + 3)
    number, part = data.draw(ends), slice(*data.draw(st.tuples(ends, ends)))
    assert batches[part] == expected[part]
    if -len(expected) <= number < len(expected):
        assert batches[number] == expected[number]
    else:
        with pytest.raises(IndexError):
            batches[number]


@given(SIZES)
def test_where_a_sample_is(sizes):
    """By its rule as by its list: in a batch that holds it, and behind the same number of batches."""
    header = PlanHeader("demo-0123456789", "demo", Batches(*sizes), [])
    by_list = replace(header, batches=listed(*sizes))
    samples, firsts = np.arange(sizes[0]), [first for first, _ in by_list.batches]
    assert header.batch_numbers(samples).tolist() == by_list.batch_numbers(samples).tolist()
    assert [header.batches.batch_of(sample) for sample in samples] == header.batch_numbers(samples).tolist()
    for end in range(sizes[0] + 3):
        assert header.batches_before(end) == by_list.batches_before(end) == bisect_left(firsts, end)


@given(SIZES, st.data())
def test_a_list_with_a_rule(sizes, data):
    """It is recognised, and any other division of the samples is not taken for one."""
    batches = listed(*sizes)
    assert as_rule(batches) == Batches(*sizes)
    ends = sorted(data.draw(st.sets(st.integers(1, sizes[0]))) | {sizes[0]})
    other = tuple((a, b - a) for a, b in zip([0, *ends], ends, strict=False))
    assert tuple(as_rule(other)) == other


def test_equal_and_many():
    """Two of the same samples and size are one value; 1e18 samples are as quick as ten."""
    many = Batches(10**18, 7)
    assert len({many, Batches(10**18, 7), Batches(10**18, 8)}) == 2
    assert (many[-1], many.batch_of(10**18 - 1)) == ((10**18 - 1, 1), len(many) - 1)


@pytest.mark.parametrize(("samples", "size"), [(10, 0), (10, -1), (10, 11), (2**63, 1)])
def test_impossible_size(samples, size):
    """None, more samples than there are, or more than can be counted."""
    with pytest.raises(ValueError, match=f"allowed: 1 to all its {samples} samples"):
        Batches(samples, size)
