"""Samplers that draw from the variables' distributions, by inverse transform sampling; of them random and lhs.

The sampler gives every variable a uniform number for each sample, the numbers of correlated variables are mixed, and
the variable's distribution turns the number into a value, moved by the shift of the sample's production batch:
consecutive samples of a batch share it.

Random words have 64 bits and a number: any word of any stream is available directly, in any order. The generator is
counter-based (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011): word ``i`` of a Philox stream, keyed
by the campaign's seed and a variable's name, belongs to sample ``i``. So more samples keep the first ones, and an
additional variable does not change the others.
"""

import hashlib
import threading
from abc import abstractmethod
from collections import Counter
from collections.abc import Mapping
from functools import lru_cache
from math import pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from campaign.inputs.distributions import Constant, Continuous, Distribution, Empirical
from campaign.inputs.sampling.sampler import Correlations, SampledInputs, Sampler, joint_variables, varied
from engine.arrays import Array
from engine.mechanism.faults import did_you_mean

Words = NDArray[np.uint64]

WORDS_PER_BLOCK = 4  # Philox4x64 yields four words for each value of its counter
# purposes of streams
VALUE, BATCH, SCRAMBLE, STRATA, PLACE = "", "batch\n", "scramble\n", "strata\n", "place\n"
COMPONENT = "component\n"


class _Generator(threading.local):
    """One generator per thread, set to another stream at each call, because a new one takes seven times as long."""

    def __init__(self) -> None:
        self.philox = np.random.Philox(key=0)

    def words(self, key: Words, block: int, count: int) -> Words:
        empty = np.zeros(WORDS_PER_BLOCK, dtype=np.uint64)
        counter = np.array([block, 0, 0, 0], dtype=np.uint64)
        self.philox.state = {
            "bit_generator": "Philox",
            "state": {"counter": counter, "key": key},
            "buffer": empty,
            "buffer_pos": WORDS_PER_BLOCK,
            "has_uint32": 0,
            "uinteger": 0,
        }
        return self.philox.random_raw(count)


_generator = _Generator()


def words(seed: int, name: str, first: int, count: int, purpose: str = VALUE) -> Words:
    """Return ``count`` random words of a stream, starting at word ``first``, shape (count,)."""
    block, skipped = divmod(first, WORDS_PER_BLOCK)
    return _generator.words(_key(seed, name, purpose), block, skipped + count)[skipped:]


def uniforms(seed: int, name: str, first: int, count: int, purpose: str = VALUE) -> Array:
    """Return uniform numbers strictly inside (0, 1), shape (count,)."""
    # 52 bits, centred in their cells: neither 0 nor 1 can occur, and 1 - u is exact.
    return ((words(seed, name, first, count, purpose) >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def permutation(seed: int, name: str, size: int, first: int = 0, purpose: str = VALUE) -> NDArray[np.int64]:
    """Return a random permutation of 0 .. size - 1 from the words ``first`` to ``first + size - 1`` of a stream."""
    # stable: how other sorts order equal words is up to the library
    return np.argsort(words(seed, name, first, size, purpose), kind="stable")


@lru_cache(maxsize=4096)
def _key(seed: int, name: str, purpose: str) -> Words:
    """Return 128 bits that differ for every triple of purpose, seed and name, shape (2,)."""
    # the order of bytes is fixed, so that the key is the same on every machine
    return np.frombuffer(hashlib.sha256(f"{purpose}{seed}\n{name}".encode()).digest()[:16], dtype="<u8").astype(
        np.uint64
    )


EVENLY_SPREAD = (
    "the intervals are those of independent samples. Means and sigmas of responses close to a sum of effects of single "
    "variables are more precise than these intervals (conservative); shares far out in a tail are about as precise."
)

SPREAD_BY_SEED = "their intervals are those of independent samples, and one spread more evenly has others"

LARGEST = 10_000_000  # samples; limited because the permutation of each variable is kept in memory


class InverseTransformSampler(Sampler):
    """A sampler of uniform numbers, which the variables' distributions turn into values."""

    @abstractmethod
    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return the uniform numbers of samples ``first .. first + count - 1`` by variable, shape (count,) each.

        They are strictly inside (0, 1), and bit for bit the same however the samples are split into calls; ``names``
        are the variables that vary.
        """

    def scores(self, inputs: SampledInputs, first: int, count: int) -> dict[str, Array]:
        """Return the standard scores of the variables that vary, by name, before correlations; shape (count,) each."""
        return {name: ndtri(u) for name, u in self.uniforms(inputs, varied(inputs), first, count).items()}

    def draw(self, inputs: SampledInputs, first: int, count: int) -> dict[str, Array]:
        """Return the values of all variables."""
        u = self.uniforms(inputs, varied(inputs), first, count)
        if inputs.correlations:
            u |= correlated(u, inputs.correlations)
        for names in joint_variables(inputs.variables).values():
            u |= dict.fromkeys(names, u[min(names)])  # one number chooses the row, whatever the order of the variables
        variables = inputs.variables.items()
        return {name: quantiles(variable, inputs.seed, name, u.get(name), first, count) for name, variable in variables}


def production_batch(inputs: SampledInputs, sample: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """Return the number of the production batch of each sample, from 0; None if no variable varies by batch."""
    # Samples with the same number share all their shifts: a new number begins with every new batch of any variable.
    sizes = {v.batch.size for v in inputs.variables.values() if isinstance(v, Continuous) and v.batch}
    if not sizes:
        return None
    sample = np.asarray(sample, dtype=np.int64)
    last = int(sample.max(initial=0))
    begins = np.unique(np.concatenate([np.arange(size, last + 1, size) for size in sorted(sizes)]))
    return np.asarray(np.searchsorted(begins, sample, side="right"), dtype=np.int64)


def quantiles(variable: Distribution, seed: int, name: str, u: Array | None, first: int, count: int) -> Array:
    """Return the values of one variable at samples ``first .. first + count - 1`` for uniform ``u``; None: constant."""
    if u is None:
        return variable.ppf(np.full(count, 0.5))
    if isinstance(variable, Empirical) and variable.joint:
        return variable.rows(u)
    if not isinstance(variable, Continuous) or variable.batch is None:
        return variable.ppf(u)
    size = variable.batch.size
    begin, end = first // size, (first + max(count, 1) - 1) // size
    shifts = variable.batch.shifts(uniforms(seed, name, begin, end - begin + 1, BATCH))
    return variable.ppf(u, shifts[np.arange(first, first + count) // size - begin])


class RandomSampler(InverseTransformSampler):
    """Each sample is drawn independently of all others."""

    name = "random"
    summary = "independent random samples"
    report = "Independent random samples, as the intervals assume."
    ordered = False

    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return a random number for each variable and sample."""
        return {name: uniforms(inputs.seed, name, first, count) for name in names}


# Latin hypercube: each variable has as many equally likely strata as there are samples, with one sample in each.
#
# McKay, Beckman, Conover, "A comparison of three methods for selecting values of input variables in the analysis of
# output from a computer code", 1979. A random permutation for each variable assigns the strata to the samples.


class LatinHypercube(InverseTransformSampler):
    """Every variable is spread evenly over its distribution."""

    name = "lhs"
    summary = "Latin hypercube: each variable spread evenly over its distribution"
    report = f"Latin hypercube: every variable is spread evenly over its distribution, so {EVENLY_SPREAD}"
    not_extendable = (
        "lhs divides each range into as many strata as there are samples, so that more samples differ from the first"
    )
    not_poolable = f"{SPREAD_BY_SEED}; compute one campaign with more samples"

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError if there are too many samples."""
        if inputs.samples > LARGEST:
            raise ValueError(
                f"samples = {inputs.samples}: sampler lhs allows up to {LARGEST}, because it keeps them in memory;"
                ' write sampler = "sobol", which has no such limit'
            )

    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return, for each variable, a uniform number within each sample's own stratum."""
        drawn = {}
        for name in names:
            stratum = _strata(inputs.seed, name, inputs.samples)[first : first + count]
            # 26 bits, centred: the sum below is exact, and the quotient stays within the stratum
            bits = words(inputs.seed, name, first, count, PLACE) >> np.uint64(38)
            place = (bits.astype(np.float64) + 0.5) * 2.0**-26
            drawn[name] = (stratum + place) / inputs.samples
        return drawn


@lru_cache(maxsize=64)
def _strata(seed: int, name: str, samples: int) -> NDArray[np.int32]:
    """Return the stratum of each sample, shape (samples,); cached, so that a process computes it only once."""
    return permutation(seed, name, samples, 0, STRATA).astype(np.int32)


# -- correlated variables: a Gaussian copula, given by Spearman's rank correlations ------------------------------------
#
# The uniform numbers of correlated variables are transformed to normal scores, the scores are mixed, and the mixed
# scores are transformed back to uniform numbers, so every variable keeps its distribution. A rank correlation r does
# not depend on the distributions; the correlation of the scores is 2 sin(pi r / 6) (K. Pearson, "On further methods of
# determining correlation", 1907).


LEAST_EIGENVALUE = 1e-9  # of the scores' correlation matrix; below it, one variable is a function of the others
NEXT_TO_ONE = 1.0 - 2.0**-53  # uniform number: the double next to 1


def check_correlations(inputs: SampledInputs) -> None:
    """Raise ValueError for correlations of no two variables that vary, given twice, or that contradict each other."""
    pairs = Counter(frozenset((a, b)) for a, b, _ in inputs.correlations or ())
    for a, b, rank in inputs.correlations or ():
        entry = f'correlations, ["{a}", "{b}", {rank:g}]'
        for name in (a, b):
            if name not in inputs.variables:
                names = list(inputs.variables)
                raise ValueError(f"{entry}: no variable {name}; allowed: {', '.join(names)}{did_you_mean(name, names)}")
            if isinstance(inputs.variables[name], Constant):
                raise ValueError(f"{entry}: {name} is a constant and cannot be correlated; remove the entry")
            if getattr(inputs.variables[name], "joint", None):
                raise ValueError(f"{entry}: the rows of a table say how {name} varies with others; remove the entry")
        if a == b:
            raise ValueError(f"{entry}: a variable cannot be correlated with itself; name two variables")
        if pairs[frozenset((a, b))] > 1:
            raise ValueError(f"{entry}: this pair is given more than once; keep one entry")
    if inputs.correlations and (smallest := smallest_eigenvalue(inputs.correlations)) < LEAST_EIGENVALUE:
        scales = (n / 100 for n in range(100, 0, -1))
        possible = (s for s in scales if smallest_eigenvalue(inputs.correlations, s) >= LEAST_EIGENVALUE)
        scale = next(possible, 0.0)
        raise ValueError(
            f"correlations: contradict each other, their matrix is not positive definite (smallest eigenvalue"
            f" {smallest:.3g}); multiply all of them by at most {scale:g}"
        )


def check_joint(inputs: SampledInputs) -> None:
    """Raise ValueError unless variables that share the rows of a table have equally many."""
    for table, names in joint_variables(inputs.variables).items():
        sizes = {name: len(getattr(inputs.variables[name], "values", None) or ()) for name in names}
        if len({size for size in sizes.values() if size}) > 1:  # a file that is not read yet has none
            listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
            raise ValueError(
                f'variables.{names[0]}.joint = "{table}": its variables have different numbers of values ({listed});'
                " take all from one table"
            )


def correlated(u: Mapping[str, Array], correlations: Correlations) -> dict[str, Array]:
    """Return the uniform numbers of the correlated variables, mixed in the order of ``u``; shapes stay the same."""
    names = [name for name in u if any(name in pair for pair in correlations)]
    scores, mixed = [ndtri(u[name]) for name in names], {names[0]: u[names[0]]}
    for name, row in zip(names[1:], _factor(tuple(names), correlations)[1:], strict=True):
        # a plain sum: the bits of a matrix product depend on the number of samples
        score = sum(share * z for share, z in zip(row, scores, strict=False) if share)
        mixed[name] = np.clip(ndtr(score), 1.0 - NEXT_TO_ONE, NEXT_TO_ONE)
    return mixed


def matrix(names: tuple[str, ...], correlations: Correlations, scale: float = 1.0) -> Array:
    """Return the correlation matrix of the normal scores, shape (k, k), with all rank correlations scaled."""
    result, at = np.eye(len(names)), {name: i for i, name in enumerate(names)}
    for a, b, rank in correlations:
        result[at[a], at[b]] = result[at[b], at[a]] = 2.0 * sin(pi * scale * rank / 6.0)
    return result


def smallest_eigenvalue(correlations: Correlations, scale: float = 1.0) -> float:
    """Return the smallest eigenvalue of the scores' correlation matrix."""
    names = tuple(dict.fromkeys(name for a, b, _ in correlations for name in (a, b)))
    return float(np.linalg.eigvalsh(matrix(names, correlations, scale))[0])


@lru_cache(maxsize=8)
def _factor(names: tuple[str, ...], correlations: Correlations) -> tuple[tuple[float, ...], ...]:
    """Return the rows of the lower Cholesky factor; plain arithmetic, as a library's blocking would change bits."""
    rows: list[tuple[float, ...]] = []
    for i, target in enumerate(matrix(names, correlations).tolist()):
        row: list[float] = []
        for j in range(i):
            product = sum(a * b for a, b in zip(row, rows[j], strict=False))
            row.append((target[j] - product) / rows[j][j])
        row.append(sqrt(1.0 - sum(a * a for a in row)))
        rows.append(tuple(row))
    return tuple(rows)
