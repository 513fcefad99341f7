"""Production batches: consecutive samples whose variables share a shift."""

import numpy as np
from numpy.typing import NDArray

from campaign.inputs.distributions import Continuous, Distribution
from campaign.inputs.sampling.sampler import SampledInputs
from campaign.inputs.sampling.streams import BATCH, uniforms
from engine.arrays import Array


def production_batch(inputs: SampledInputs, sample: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """Return the number of the production batch of each sample, from 0, in the shape of ``sample``.

    Samples with the same number share all their shifts. If variables have batches of different sizes, a new number
    begins with every new batch of any variable. None if no variable varies by production batch.
    """
    sizes = {v.batch.size for v in inputs.variables.values() if isinstance(v, Continuous) and v.batch}
    if not sizes:
        return None
    sample = np.asarray(sample, dtype=np.int64)
    last = int(sample.max(initial=0))
    begins = np.unique(np.concatenate([np.arange(size, last + 1, size) for size in sorted(sizes)]))
    return np.asarray(np.searchsorted(begins, sample, side="right"), dtype=np.int64)


def quantiles(variable: Distribution, seed: int, name: str, u: Array | None, first: int, count: int) -> Array:
    """Return the values of one variable at samples ``first .. first + count - 1``, shape (count,).

    ``u`` has its uniform numbers, inside (0, 1), shape (count,); None for a constant.
    """
    if u is None:
        return variable.ppf(np.full(count, 0.5))
    if not isinstance(variable, Continuous) or variable.batch is None:
        return variable.ppf(u)
    size = variable.batch.size
    begin, end = first // size, (first + max(count, 1) - 1) // size
    shifts = variable.batch.shifts(uniforms(seed, name, begin, end - begin + 1, BATCH))
    return variable.ppf(u, shifts[np.arange(first, first + count) // size - begin])
