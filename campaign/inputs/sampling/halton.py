"""Scrambled Halton points: digits of the sample number in a prime base for each variable, mirrored and permuted.

J. H. Halton, "On the efficiency of certain quasi-random sequences of points", 1960. Every digit has an independent
random permutation, as in A. B. Owen, "A randomized Halton algorithm in R", 2017.
"""

from functools import lru_cache
from math import floor, log

import numpy as np
from numpy.typing import NDArray

from campaign.inputs.sampling.inverse_transform import EVENLY_SPREAD, InverseTransformSampler
from campaign.inputs.sampling.sampler import SampledInputs
from campaign.inputs.sampling.streams import SCRAMBLE, permutation
from engine.arrays import Array

BITS = 52  # a point keeps as many digits as fit into these


class Halton(InverseTransformSampler):
    """Samples are spread evenly in all variables at once."""

    name = "halton"
    summary = "scrambled Halton sequence: spread evenly in all variables at once"
    report = f"Scrambled Halton sequence: evenly spread in all variables at once, so {EVENLY_SPREAD}"

    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return the points of the sequence, one dimension per variable."""
        return halton(inputs.seed, names, first, count)


def halton(seed: int, names: list[str], first: int, count: int) -> dict[str, Array]:
    """Return samples ``first .. first + count - 1`` of all variables by name, uniform inside (0, 1), each (count,)."""
    number = np.arange(first, first + count)
    bases = primes(len(names))
    return {name: _points(seed, name, base, number) for name, base in zip(names, bases, strict=True)}


def _points(seed: int, name: str, base: int, number: NDArray[np.int64]) -> Array:
    """Return the points of one variable by their numbers, shape (count,)."""
    permuted, endings = _digits(seed, name, base)
    point, left, last = np.zeros_like(number), number, int(number.max(initial=0))
    used = 0
    while base**used <= last:
        left, digit = np.divmod(left, base)
        point = point * base + permuted[used][digit]
        used += 1
    whole = point * base ** (len(permuted) - used) + endings[used]
    return np.asarray((whole.astype(np.float64) + 0.5) / float(base ** len(permuted)), dtype=np.float64)


@lru_cache(maxsize=1024)
def _digits(seed: int, name: str, base: int) -> tuple[NDArray[np.int64], list[int]]:
    """Return the permutation of every digit, shape (digits, base), and the permuted trailing zeros from each digit on.

    A number has infinitely many zeros after its last digit, and they are permuted like any other digit.
    """
    count = floor(BITS / log(base, 2))
    permuted = np.array([permutation(seed, name, base, base * digit, SCRAMBLE) for digit in range(count)])
    endings = [0] * (count + 1)
    for digit in range(count - 1, -1, -1):
        endings[digit] = int(permuted[digit][0]) * base ** (count - 1 - digit) + endings[digit + 1]
    return permuted, endings


@lru_cache(maxsize=8)
def primes(count: int) -> tuple[int, ...]:
    """Return the first primes."""
    first: list[int] = []
    candidate = 2
    while len(first) < count:
        if all(candidate % prime for prime in first):
            first.append(candidate)
        candidate += 1
    return tuple(first)
