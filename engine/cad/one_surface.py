"""Groups of pieces that are one, found without comparing each with each."""

from collections.abc import Callable

import numpy as np

from engine.arrays import Array


def groups_of_one(features: Array, near: float, are_one: Callable[[int, int], bool]) -> list[list[int]]:
    """Return the pieces of each group: linked, directly or through others, by pairs that are one.

    Parameters
    ----------
    features : array
        Numbers of each piece that differ by less than `near` between two that are one, shape (n, k).
    near : float
        Of the features.
    are_one : callable
        Tells of two pieces, by their places, whether they are one; asked only where all features are near.

    Returns
    -------
    list of list of int
        Places in their order, the groups in that of their first one.
    """
    group_of = np.arange(len(features))
    for place in range(len(features)):
        close = (np.abs(features[:place] - features[place]) < near).all(axis=1)
        for other in np.flatnonzero(close).tolist():
            if group_of[other] != group_of[place] and are_one(other, place):
                joined = group_of[other], group_of[place]
                group_of[np.isin(group_of, joined)] = min(joined)
    return [np.flatnonzero(group_of == group).tolist() for group in np.unique(group_of)]
