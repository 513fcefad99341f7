"""The Shapley value: the division of a total among players who achieve it together (Shapley 1953).

A player's share is what it adds to the worth of the players before it, averaged over all orders in which the players
can enter. The worth of a subset of variables is, for example, the share of a response's variance that its variables
explain; what two variables explain only together is then split between them (Owen 2014). The definition also holds for
correlated variables (Song, Nelson, Staum 2016).
"""

import math

import numpy as np

from reporting.arrays import Array


def shapley_values(worth: Array) -> Array:
    """Return the share of each of k players, shape (k, ...), from the worth of each subset, shape (2^k, ...).

    Player i belongs to the subsets whose number has bit i; subset 0 is empty. The shares add up to the worth of all
    players minus that of the empty set.
    """
    k = worth.shape[0].bit_length() - 1
    subsets = np.arange(2**k)
    size = np.array([subset.bit_count() for subset in range(2**k)])
    weight = np.array([1 / (k * math.comb(k - 1, s)) if s < k else 0.0 for s in range(k + 1)])
    shares = np.empty((k, *worth.shape[1:]))
    for i in range(k):
        without = subsets[(subsets >> i & 1) == 0]
        shares[i] = np.tensordot(weight[size[without]], worth[without | 1 << i] - worth[without], axes=1)
    return shares
