"""Quasi-random points, spread evenly in all variables at once: Sobol, Halton, and Saltelli's design of Sobol points."""

from functools import lru_cache
from math import floor, log

import numpy as np
from numpy.typing import NDArray

from campaign.inputs.sampling.inverse_transform import (
    EVENLY_SPREAD,
    SCRAMBLE,
    SPREAD_BY_SEED,
    InverseTransformSampler,
    permutation,
    words,
)
from campaign.inputs.sampling.sampler import SampledInputs, dependence, varied
from engine.arrays import Array

DIGITS = 52  # binary digits of a Sobol point
OWN_DIGITS = 30  # of an unscrambled point, and the most that its number may have; scipy's fast_forward allows up to 32
DEPTHS = 4  # columns are made in groups of this size, so that a process that draws many batches makes few groups
BITS = 52  # a Halton point keeps as many digits in its base as fit into these
NOT_POOLABLE = (
    f"{SPREAD_BY_SEED}; raise the samples of one campaign, which keeps its rows and fills the gaps between them"
)
MOST_VARIABLES = 10_600  # of Saltelli's design: each takes two dimensions, and there are direction numbers for 21,201

Integers = NDArray[np.uint64]


# Scrambled Sobol points: the first 2^k samples have one in each of 2^k equal strata of every variable, for every k.
#
# I. M. Sobol, "On the distribution of points in a cube", 1967; direction numbers of S. Joe and F. Y. Kuo, "Constructing
# Sobol sequences with better two-dimensional projections", 2008, as scipy holds them; random linear scramble and
# digital shift of J. Matousek, "On the L2-discrepancy for anchored boxes", 1998, with random words from the campaign's
# streams.
#
# In binary digits, point i of a variable is x(i) = L C b(i) + e modulo 2, where b(i) are the digits of i, C is the
# variable's generator matrix, L a random lower triangular matrix with ones on its diagonal, and e a random vector. The
# columns of L C are kept as integers, so a point is e and the columns for the ones of i, combined by exclusive or.


class Sobol(InverseTransformSampler):
    """Samples are spread evenly in all variables at once."""

    name = "sobol"
    summary = "scrambled Sobol' sequence: spread evenly in all variables at once"
    report = f"Scrambled Sobol' sequence: evenly spread in all variables at once, so {EVENLY_SPREAD}"
    not_poolable = NOT_POOLABLE

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
    """Return the columns of the generator matrices C as integers of 52 binary digits, shape (depth, variables)."""
    # scipy numbers its points in Gray code, so point 2^k is the exclusive or of columns k and k - 1.
    from scipy.stats import qmc

    engine = qmc.Sobol(variables, scramble=False, bits=OWN_DIGITS)
    columns, before = np.zeros((depth, variables), dtype=np.uint64), np.zeros(variables, dtype=np.uint64)
    for k in range(depth):
        engine.fast_forward(2**k - engine.num_generated)
        before ^= (engine.random(1)[0] * 2.0**DIGITS).astype(np.uint64)
        columns[k] = before
    return columns


# Scrambled Halton points: digits of the sample number in a prime base for each variable, mirrored and permuted.
#
# J. H. Halton, "On the efficiency of certain quasi-random sequences of points", 1960. Every digit has an independent
# random permutation, as in A. B. Owen, "A randomized Halton algorithm in R", 2017.


class Halton(InverseTransformSampler):
    """Samples are spread evenly in all variables at once."""

    name = "halton"
    summary = "scrambled Halton sequence: spread evenly in all variables at once"
    report = f"Scrambled Halton sequence: evenly spread in all variables at once, so {EVENLY_SPREAD}"
    not_poolable = NOT_POOLABLE

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
    """Return the permutation of every digit, shape (digits, base), and permuted trailing zeros from each digit on."""
    # A number has infinitely many zeros after its last digit, and they are permuted like any other digit.
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


# Saltelli's design: two independent samples A and B, and A with one variable at a time taken from B.
#
# A. Saltelli et al., "Variance based sensitivity analysis of model output. Design and estimator for the total
# sensitivity index", 2010. Only this design has pairs of runs that differ in one variable alone, which show its
# interactions.
#
# A and B are the halves of one scrambled Sobol sequence with two dimensions per variable. With k variables, sample s
# belongs to row i = s // (k + 2) of the design, and s % (k + 2) selects its run: 0 that of A, 1 that of B, 2 + j that
# of A with variable j from B. So more samples keep the first ones, and the rows of A are the samples of sampler sobol.


class Saltelli(InverseTransformSampler):
    """Two samples, and combinations of them that give the variables' total indices."""

    name = "saltelli"
    summary = "Saltelli's design, for total Sobol' indices"
    report = (
        "Saltelli's design: two scrambled Sobol' samples A and B, and copies of A with one variable taken from B. The "
        "copies repeat values and add no independent samples: every statistic, interval, share and tail here is over A "
        "and B alone, 2 of k + 2 runs with k variables; the copies serve the total indices. A and B are evenly "
        f"spread, so {EVENLY_SPREAD}"
    )
    not_poolable = "a design has its indices row by row; raise the samples of one campaign, which keeps its rows"

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError unless the variables are independent and the samples form a complete design."""
        if key := dependence(inputs):
            raise ValueError(
                f"{key}: sampler saltelli changes one variable at a time, so the variables must be independent;"
                ' remove it, or write sampler = "sobol"'
            )
        if inputs.stop:
            raise ValueError(
                "stop: samples of sampler saltelli repeat each other's values, so they are not independent, and a"
                ' stopping rule cannot judge an interval by them; remove stop, or write sampler = "sobol"'
            )
        k = len(varied(inputs))
        if not 0 < k <= MOST_VARIABLES:
            raise ValueError(
                f"variables: {k} of them vary; sampler saltelli allows 1 to {MOST_VARIABLES}, because each takes two"
                ' dimensions of a Sobol sequence; change their number, or write sampler = "random"'
            )
        sizes = nearest_sizes(k, inputs.samples)
        if inputs.samples not in sizes:
            raise ValueError(
                f"samples = {inputs.samples}: sampler saltelli needs n ({k} + 2) samples for {k} variables, where n is"
                f" a power of 2; write samples = {' or '.join(map(str, sizes))}"
            )

    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return the points of A, of B, and of A with one variable from B."""
        width = len(names) + 2
        row, run = np.divmod(np.arange(first, first + count), width)
        begin, end = first // width, (first + count - 1) // width
        of_b = [f"B\n{name}" for name in names]  # scrambles depend on the name, so B's dimensions have their own
        points = sobol(inputs.seed, [*names, *of_b], begin, end - begin + 1)
        return {
            name: np.where((run == 1) | (run == 2 + j), points[other][row - begin], points[name][row - begin])
            for j, (name, other) in enumerate(zip(names, of_b, strict=True))
        }

    def independent(self, inputs: SampledInputs, sample: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which samples belong to A or B, in the shape of ``sample``."""
        return np.asarray(sample % (len(varied(inputs)) + 2) < 2)

    def designed(self, inputs: SampledInputs) -> tuple[str, ...]:
        """Return the variables that vary."""
        return tuple(varied(inputs))


def nearest_sizes(variables: int, samples: int) -> tuple[int, ...]:
    """Return the sizes ``n (variables + 2)``, n a power of 2, of designs next to ``samples``, or itself if one."""
    width = variables + 2
    below = width << max((samples // width).bit_length() - 1, 0)
    return (below,) if samples <= below else (below, 2 * below)
