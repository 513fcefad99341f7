"""Sampling: the inputs of a sample are a function of the spec and the sample number alone.

A sampler gives every variable a uniform number for each sample; correlated variables exchange theirs; the variable's
distribution turns it into a value, moved by the shift of the sample's production batch. Samplers that enumerate
(corners, grid, list) give the values themselves.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from campaign.inputs.distributions import Array, Constant, Continuous, Distribution
from campaign.inputs.sampling.correlation import correlated
from campaign.inputs.sampling.enumerated import corners, grid, listed
from campaign.inputs.sampling.halton import halton
from campaign.inputs.sampling.lhs import stratified
from campaign.inputs.sampling.random import BATCH, uniforms
from campaign.inputs.sampling.saltelli import saltelli
from campaign.inputs.sampling.sobol import sobol

if TYPE_CHECKING:
    from campaign.spec.campaign_file import CampaignSpec

__all__ = ["draw", "draws_by_themselves", "keeps_first", "production_batch", "uniforms", "varied"]


def draw(spec: "CampaignSpec", first: int, count: int) -> dict[str, Array]:
    """Draw samples ``first .. first + count - 1`` of all variables.

    Parameters
    ----------
    spec : CampaignSpec
        The campaign.
    first, count : int
        First sample number and number of samples.

    Returns
    -------
    dict of str to ndarray, each of shape (count,)
        Values by variable, each in its target's unit; the same bits whatever piece is drawn.
    """
    match spec.sampler:
        case "worst_case":
            return corners(spec.variables, first, count)
        case "grid":
            return grid(spec.variables, spec.grid or {}, first, count)
        case "list":
            return listed(spec.rows(), list(spec.variables), first, count)
    u = _uniforms(spec, first, count)
    if spec.correlations:
        u |= correlated(u, spec.correlations)
    return {name: _values(v, spec.seed, name, u.get(name), first, count) for name, v in spec.variables.items()}


def keeps_first(spec: "CampaignSpec") -> str | None:
    """Return None if the first samples stay when more are asked for, otherwise why they do not, in words."""
    match spec.sampler:
        case "lhs":
            return "lhs divides each range into as many strata as there are samples: more samples are others"
        case "worst_case":
            return "worst_case has all corners and the middle, and no more"
        case "grid":
            return "a grid has all combinations of its levels, and no more"
    return None


def draws_by_themselves(spec: "CampaignSpec", sample: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which samples are draws of their own: of sampler saltelli those of A and B; the others repeat values."""
    if spec.sampler != "saltelli":
        return np.ones(sample.shape, np.bool_)
    return np.asarray(sample % (len(varied(spec)) + 2) < 2)


def production_batch(spec: "CampaignSpec", sample: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """Return the number of the production batch that each sample is in; None if no variable varies by batch.

    Samples of one number share all their shifts. Where variables have batches of different sizes, a new number begins
    with every new batch of any of them.

    Parameters
    ----------
    spec : CampaignSpec
        The campaign.
    sample : array of int64
        Sample numbers.

    Returns
    -------
    array of int64 or None
        Numbers from 0, in the shape of ``sample``.
    """
    sizes = {v.batch.size for v in spec.variables.values() if isinstance(v, Continuous) and v.batch}
    if not sizes:
        return None
    sample = np.asarray(sample, dtype=np.int64)
    last = int(sample.max(initial=0))
    begins = np.unique(np.concatenate([np.arange(size, last + 1, size) for size in sorted(sizes)]))
    return np.asarray(np.searchsorted(begins, sample, side="right"), dtype=np.int64)


def varied(spec: "CampaignSpec") -> list[str]:
    """Return the names of the variables that vary, in their order: the dimensions of a sampler."""
    return [name for name, variable in spec.variables.items() if not isinstance(variable, Constant)]


def _uniforms(spec: "CampaignSpec", first: int, count: int) -> dict[str, Array]:
    """Return the uniform numbers of all variables that vary, each of shape (count,), strictly inside (0, 1)."""
    names = varied(spec)
    match spec.sampler:
        case "lhs":
            return {name: stratified(spec.seed, name, spec.samples, first, count) for name in names}
        case "sobol":
            return sobol(spec.seed, names, first, count)
        case "halton":
            return halton(spec.seed, names, first, count)
        case "saltelli":
            return saltelli(spec.seed, names, first, count)
    return {name: uniforms(spec.seed, name, first, count) for name in names}


def _values(variable: Distribution, seed: int, name: str, u: Array | None, first: int, count: int) -> Array:
    """Return the values of one variable, shape (count,)."""
    if u is None:
        return variable.ppf(np.full(count, 0.5))
    if not isinstance(variable, Continuous) or variable.batch is None:
        return variable.ppf(u)
    begin, end = first // variable.batch.size, (first + max(count, 1) - 1) // variable.batch.size
    number = np.arange(first, first + count) // variable.batch.size - begin
    shifts = variable.batch.shifts(uniforms(seed, name, begin, end - begin + 1, BATCH))
    return variable.ppf(u, shifts[number])
