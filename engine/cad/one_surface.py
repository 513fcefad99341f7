"""Group pieces that belong to one surface or circle without comparing every pair."""

from collections.abc import Callable

import numpy as np

from engine.arrays import Array


def groups_of_one(features: Array, near: float, are_one: Callable[[int, int], bool]) -> list[list[int]]:
    """Return groups of pieces that are linked, directly or through others, by pairs that belong together.

    `features`, shape (n, k), differ by less than `near` between two pieces that belong together; `are_one` is called
    with two indices only then. Indices ascend in each group; the groups are ordered by their first index.
    """
    group_of = np.arange(len(features))
    for place in range(len(features)):
        close = (np.abs(features[:place] - features[place]) < near).all(axis=1)
        for other in np.flatnonzero(close).tolist():
            if group_of[other] != group_of[place] and are_one(other, place):
                joined = group_of[other], group_of[place]
                group_of[np.isin(group_of, joined)] = min(joined)
    return [np.flatnonzero(group_of == group).tolist() for group in np.unique(group_of)]
