"""Sampling: the inputs of a sample are a function of the campaign file and the sample number alone.

Each sampler is one object; `SAMPLERS` is the only place that lists them. Most samplers draw from the variables'
distributions (`inverse_transform`, `quasi_random`, `importance`), the others enumerate values (`enumerating`).
"""

from campaign.inputs.sampling.enumerating import Corners, Grid, UserTable
from campaign.inputs.sampling.importance import ImportanceSampler
from campaign.inputs.sampling.inverse_transform import (
    LatinHypercube,
    RandomSampler,
    check_correlations,
    check_joint,
    production_batch,
)
from campaign.inputs.sampling.quasi_random import Halton, Saltelli, Sobol
from campaign.inputs.sampling.sampler import SampledInputs, Sampler
from engine.arrays import Array
from engine.mechanism.faults import did_you_mean

__all__ = ["SAMPLERS", "SampledInputs", "Sampler", "check_sampling", "draw", "production_batch", "sampler_named"]

SAMPLERS: dict[str, Sampler] = {
    sampler.name: sampler
    for sampler in (
        RandomSampler(),
        LatinHypercube(),
        Sobol(),
        Halton(),
        Saltelli(),
        ImportanceSampler(),
        Corners(),
        Grid(),
        UserTable(),
    )
}


def sampler_named(name: str) -> Sampler:
    """Return a sampler by its name; raise ValueError if there is none."""
    if name not in SAMPLERS:
        raise ValueError(
            f'sampler = "{name}": no such sampler; allowed: {", ".join(SAMPLERS)}{did_you_mean(name, SAMPLERS)}'
        )
    return SAMPLERS[name]


def draw(inputs: SampledInputs, first: int, count: int) -> dict[str, Array]:
    """Return samples ``first .. first + count - 1`` of all variables, shape (count,) each, in their targets' units."""
    # The values are bit for bit the same however the samples are split into calls.
    return sampler_named(inputs.sampler).draw(inputs, first, count)


def check_sampling(inputs: SampledInputs) -> None:
    """Raise ValueError, with key, value and remedy, unless the samples can be drawn and every key has an effect."""
    check_correlations(inputs)
    check_joint(inputs)
    sampler = sampler_named(inputs.sampler)
    for other in SAMPLERS.values():
        key = other.own_key
        if key and other is not sampler and getattr(inputs, key) is not None:
            raise ValueError(f'{key} is only for sampler "{other.name}"; write sampler = "{other.name}" or remove it')
    sampler.check(inputs)
    if inputs.stop and sampler.not_extendable:
        raise ValueError(
            f"stop: a stopping rule needs a sampler whose first samples are a valid sample of their own, but"
            f" {sampler.not_extendable}; remove stop"
        )
