"""Halton sequences."""

import numpy as np

from campaign.inputs.sampling.halton import halton, primes
from tests.campaign.statistics import strata


def test_halton_is_balanced_in_every_base():
    """The first b^k samples have one in each of b^k strata of the variable with base b."""
    names = [f"v{i}" for i in range(6)]
    drawn = halton(7, names, 0, 2401)
    for name, base in zip(names, primes(6), strict=True):
        size = base ** int(np.log(2401.5) / np.log(base))
        assert (strata(drawn[name][:size], size) == 1).all()


def test_halton_permutes_every_digit():
    """Digit by digit the points are permuted radical inverses, in a different way for every digit, seed and name."""
    number, base = np.arange(625), 5
    u = halton(7, ["a", "b", "c"], 0, 625)["c"]
    digits = (u[:, None] * base ** np.arange(1, 5)).astype(int) % base
    maps = [[set(digits[number // base**k % base == d, k].tolist()) for d in range(base)] for k in range(4)]
    assert all(len(image) == 1 for images in maps for image in images)
    assert len({tuple(min(image) for image in images) for images in maps}) > 1
    assert not np.array_equal(u, halton(8, ["a", "b", "c"], 0, 625)["c"])
