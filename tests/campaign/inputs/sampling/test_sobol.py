"""Sobol' sequences."""

import numpy as np
import pytest
from scipy.stats import qmc

from campaign.inputs.sampling import draw
from campaign.inputs.sampling.sobol import DIGITS, generators
from tests.campaign.inputs.sampling.campaigns import UNIT, spec
from tests.campaign.statistics import strata


@pytest.mark.parametrize("k", [0, 1, 5, 10])
def test_sobol_is_balanced(k):
    """The first 2^k samples have one in each of 2^k strata of each variable, and so has every later block of them."""
    drawn = draw(spec({f"v{i}": UNIT for i in range(12)}, samples=4096, sampler="sobol"), 0, 4096)
    for u in drawn.values():
        assert (strata(u[: 2**k], 2**k) == 1).all()
        assert (strata(u[3 * 2**k : 4 * 2**k], 2**k) == 1).all()


def test_sobol_pairs_are_nets():
    """The first two variables are a (0, m, 2)-net: one of 2^10 points in every elementary rectangle."""
    a, b = draw(spec({"a": UNIT, "b": UNIT}, samples=1024, sampler="sobol"), 0, 1024).values()
    for k in range(11):
        cell = (a * 2**k).astype(int) * 2 ** (10 - k) + (b * 2 ** (10 - k)).astype(int)
        assert np.unique(cell).size == 1024


def test_generators_are_scipys():
    """The unscrambled points are the set that scipy's engine gives."""
    columns, number = generators(9, 8), np.arange(256, dtype=np.uint64)
    points = np.zeros((256, 9), dtype=np.uint64)
    for k, column in enumerate(columns):
        points ^= column * (number >> np.uint64(k) & np.uint64(1))[:, None]
    theirs = qmc.Sobol(9, scramble=False).random(256)
    ours = points * 2.0**-DIGITS
    assert np.array_equal(np.sort(ours, axis=0), np.sort(theirs, axis=0))
    assert {tuple(row) for row in ours} == {tuple(row) for row in theirs}
