"""Scrambled Sobol points: the first 2^k samples have one in each of 2^k equal strata of every variable, for every k.

I. M. Sobol, "On the distribution of points in a cube", 1967; direction numbers of S. Joe and F. Y. Kuo, "Constructing
Sobol sequences with better two-dimensional projections", 2008, as scipy holds them; random linear scramble and digital
shift of J. Matousek, "On the L2-discrepancy for anchored boxes", 1998, with random words from the campaign's streams.

In binary digits, point i of a variable is x(i) = L C b(i) + e modulo 2, where b(i) are the digits of i, C is the
variable's generator matrix, L a random lower triangular matrix with ones on its diagonal, and e a random vector. The
columns of L C are kept as integers, so a point is e and the columns for the ones of i, combined by exclusive or.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from campaign.inputs.sampling.inverse_transform import EVENLY_SPREAD, InverseTransformSampler
from campaign.inputs.sampling.sampler import SampledInputs
from campaign.inputs.sampling.streams import SCRAMBLE, words
from engine.arrays import Array

DIGITS = 52  # binary digits of a point
OWN_DIGITS = 30  # of an unscrambled point, and the most that its number may have; scipy's fast_forward allows up to 32
DEPTHS = 4  # columns are made in groups of this size, so that a process that draws many batches makes few groups

Integers = NDArray[np.uint64]


class Sobol(InverseTransformSampler):
    """Samples are spread evenly in all variables at once."""

    name = "sobol"
    summary = "scrambled Sobol' sequence: spread evenly in all variables at once"
    report = f"Scrambled Sobol' sequence: evenly spread in all variables at once, so {EVENLY_SPREAD}"

    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return the points of the sequence, one dimension per variable."""
        return sobol(inputs.seed, names, first, count)


def sobol(seed: int, names: list[str], first: int, count: int) -> dict[str, Array]:
    """Return samples ``first .. first + count - 1`` of all variables by name, uniform inside (0, 1), each (count,)."""
    depth = (first + count).bit_length()
    columns, shifts = _scrambled(seed, tuple(names), -(-depth // DEPTHS) * DEPTHS)
    number = np.arange(first, first + count, dtype=np.uint64)
    x = np.repeat(shifts[:, None], count, axis=1)
    for k in range(depth):
        x ^= columns[k][:, None] * (number >> np.uint64(k) & np.uint64(1))
    u = (x.astype(np.float64) + 0.5) * 2.0**-DIGITS
    return dict(zip(names, u, strict=True))


@lru_cache(maxsize=8)
def _scrambled(seed: int, names: tuple[str, ...], depth: int) -> tuple[Integers, Integers]:
    """Return the columns of L C, shape (depth, variables), and the shifts e, shape (variables,)."""
    columns = generators(len(names), depth)
    shifts = np.zeros(len(names), dtype=np.uint64)
    for j, name in enumerate(names):
        own = words(seed, name, 0, DIGITS + 1, SCRAMBLE) >> np.uint64(64 - DIGITS)
        shifts[j] = own[DIGITS]
        columns[:, j] = _times(_lower_triangle(own[:DIGITS]), columns[:, j])
    return columns, shifts


def _lower_triangle(random: Integers) -> Integers:
    """Return the rows of a random lower triangular matrix with ones on its diagonal; digit 0 is the leading one."""
    row = np.arange(DIGITS, dtype=np.uint64)
    diagonal = np.uint64(1) << (np.uint64(DIGITS - 1) - row)
    before = ~((diagonal << np.uint64(1)) - np.uint64(1))
    triangle: Integers = (random & before) | diagonal
    return triangle


def _times(matrix: Integers, columns: Integers) -> Integers:
    """Return the products modulo 2 of a matrix, given by rows, with vectors of digits, shape (depth,)."""
    product = np.zeros_like(columns)
    for row in matrix:
        product = product << np.uint64(1) | np.bitwise_count(row & columns).astype(np.uint64) & np.uint64(1)
    return product


def generators(variables: int, depth: int) -> Integers:
    """Return the columns of the generator matrices C as integers of 52 binary digits, shape (depth, variables).

    scipy numbers its points in Gray code, so point 2^k is the exclusive or of columns k and k - 1.
    """
    from scipy.stats import qmc

    engine = qmc.Sobol(variables, scramble=False, bits=OWN_DIGITS)
    columns, before = np.zeros((depth, variables), dtype=np.uint64), np.zeros(variables, dtype=np.uint64)
    for k in range(depth):
        engine.fast_forward(2**k - engine.num_generated)
        before ^= (engine.random(1)[0] * 2.0**DIGITS).astype(np.uint64)
        columns[k] = before
    return columns
