"""Sampling: the inputs of a sample are a function of the spec and the sample number alone.

`random`: the value of a variable is a function of (seed, sample number, variable name).

Counter-based: word ``i`` of a Philox stream, keyed by seed and name, belongs to sample ``i``. So nothing
depends on batches, workers or order, more samples keep the first ones, and another variable leaves the others
alone.

`worst_case`: every combination of the ends of all variables, then the middle of all (paper, eqs. 24 and 25).
"""

import hashlib
from collections.abc import Mapping

import numpy as np

from campaign.distributions import Array, Distribution

WORDS_PER_BLOCK = 4  # Philox4x64 yields four words for each value of its counter


def draw(
    variables: Mapping[str, Distribution], seed: int, first: int, count: int, sampler: str = "random"
) -> dict[str, Array]:
    """Draw samples ``first .. first + count - 1`` of all variables.

    Parameters
    ----------
    variables : mapping of str to Distribution
        The variables by name.
    seed : int
        Seed of the campaign, >= 0.
    first, count : int
        First sample number and number of samples.
    sampler : str
        ``random`` or ``worst_case``.

    Returns
    -------
    dict of str to ndarray, each of shape (count,)
        Values, each in its target's unit.
    """
    if sampler == "worst_case":
        return corners(variables, first, count)
    return {name: v.ppf(uniforms(seed, name, first, count)) for name, v in variables.items()}


def corners(variables: Mapping[str, Distribution], first: int, count: int) -> dict[str, Array]:
    """Return corners ``first .. first + count - 1`` of the box that the variables' ranges span, each of shape (count,).

    Bit j of the number says at which end variable j is; the one after the last corner is the middle of the box.
    """
    number, drawn = np.arange(first, first + count), {}
    for j, (name, variable) in enumerate(variables.items()):
        low, high = variable.support()
        ends = np.where(number >> j & 1, high, low)
        drawn[name] = np.where(number == 2 ** len(variables), 0.5 * (low + high), ends)
    return drawn


def uniforms(seed: int, name: str, first: int, count: int) -> Array:
    """Return the uniform numbers of one variable, strictly inside (0, 1), shape (count,)."""
    block, skipped = divmod(first, WORDS_PER_BLOCK)
    stream = np.random.Philox(key=_key(seed, name), counter=block)
    words = stream.random_raw(skipped + count)[skipped:]
    # 52 bits, centred in their cells: neither 0 nor 1 can appear, and 1 - u is exact.
    return ((words >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def _key(seed: int, name: str) -> int:
    """Return 128 bits that differ for every pair of seed and name."""
    return int.from_bytes(hashlib.sha256(f"{seed}\n{name}".encode()).digest()[:16], "little")
