"""Latin hypercube: each variable has as many equally likely strata as there are samples, with one sample in each.

McKay, Beckman, Conover, "A comparison of three methods for selecting values of input variables in the analysis of
output from a computer code", 1979. A random permutation for each variable assigns the strata to the samples.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from campaign.inputs.sampling.inverse_transform import EVENLY_SPREAD, InverseTransformSampler
from campaign.inputs.sampling.sampler import SampledInputs
from campaign.inputs.sampling.streams import PLACE, STRATA, permutation, words
from engine.arrays import Array

LARGEST = 10_000_000  # samples; limited because the permutation of each variable is kept in memory


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
    """Return samples ``first .. first + count - 1`` of a variable, uniform numbers inside (0, 1), shape (count,).

    ``samples`` is the number of samples of the whole campaign, and so of strata; at most 10 million.
    """
    stratum = _strata(seed, name, samples)[first : first + count]
    # 26 bits, centred: the sum below is exact, and the quotient stays within the stratum
    place = ((words(seed, name, first, count, PLACE) >> np.uint64(38)).astype(np.float64) + 0.5) * 2.0**-26
    return (stratum + place) / samples


@lru_cache(maxsize=64)
def _strata(seed: int, name: str, samples: int) -> NDArray[np.int32]:
    """Return the stratum of each sample, shape (samples,); cached, so that a process computes it only once."""
    return permutation(seed, name, samples, 0, STRATA).astype(np.int32)
