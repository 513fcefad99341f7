"""Groups of what is one, against a walk through all pairs."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from engine.cad.merged_pieces import groups_of_one


@given(st.lists(st.integers(0, 30), max_size=25))
def test_links_through_others_count(numbers):
    """Whole numbers that differ by 1 are one, so runs without a hole are groups."""
    values = np.array(numbers, float)
    groups = groups_of_one(values[:, None], 1.5, lambda a, b: abs(values[a] - values[b]) <= 1)
    assert sorted(place for group in groups for place in group) == list(range(len(numbers)))
    assert [group[0] for group in groups] == sorted(group[0] for group in groups)
    present = sorted(set(numbers))
    runs = np.split(present, np.flatnonzero(np.diff(present) > 1) + 1) if present else []
    assert sorted(sorted({numbers[place] for place in group}) for group in groups) == [run.tolist() for run in runs]


def test_only_near_pairs_are_compared():
    """A thousand pieces far from each other need no comparison."""
    features = 10.0 * np.arange(1000.0)[:, None]

    def compared(a, b):
        raise AssertionError("they are not near")

    assert groups_of_one(features, 1.0, compared) == [[place] for place in range(1000)]
