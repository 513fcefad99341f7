"""Samplers that draw from the variables' distributions, by inverse transform sampling; of them random and lhs.

The sampler gives every variable a uniform number for each sample, the numbers of correlated variables are mixed, and
the variable's distribution turns the number into a value, moved by the shift of the sample's production batch:
consecutive samples of a batch share it.
"""

from abc import abstractmethod
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from campaign.inputs.distributions import Continuous, Distribution
from campaign.inputs.sampling.correlation import correlated
from campaign.inputs.sampling.sampler import SampledInputs, Sampler, varied
from campaign.inputs.sampling.streams import BATCH, PLACE, STRATA, permutation, uniforms, words
from engine.arrays import Array

EVENLY_SPREAD = (
    "the intervals are those of independent samples. Means and sigmas of responses close to a sum of effects of single "
    "variables are more precise than these intervals (conservative); shares far out in a tail are about as precise."
)

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
        variables = inputs.variables.items()
        return {name: quantiles(variable, inputs.seed, name, u.get(name), first, count) for name, variable in variables}


def production_batch(inputs: SampledInputs, sample: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """Return the number of the production batch of each sample, from 0; None if no variable varies by batch.

    Samples with the same number share all their shifts: a new number begins with every new batch of any variable.
    """
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

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError if there are too many samples."""
        if inputs.samples > LARGEST:
            raise ValueError(
                f"samples = {inputs.samples}: sampler lhs allows up to {LARGEST}, because it keeps them in memory;"
                ' write sampler = "sobol", which has no such limit'
            )

    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return, for each variable, a uniform number within each sample's own stratum."""
        return {name: stratified(inputs.seed, name, inputs.samples, first, count) for name in names}


def stratified(seed: int, name: str, samples: int, first: int, count: int) -> Array:
    """Return samples ``first .. first + count - 1`` of a variable, uniform in (0, 1), one in each stratum."""
    stratum = _strata(seed, name, samples)[first : first + count]
    # 26 bits, centred: the sum below is exact, and the quotient stays within the stratum
    place = ((words(seed, name, first, count, PLACE) >> np.uint64(38)).astype(np.float64) + 0.5) * 2.0**-26
    return (stratum + place) / samples


@lru_cache(maxsize=64)
def _strata(seed: int, name: str, samples: int) -> NDArray[np.int32]:
    """Return the stratum of each sample, shape (samples,); cached, so that a process computes it only once."""
    return permutation(seed, name, samples, 0, STRATA).astype(np.int32)
