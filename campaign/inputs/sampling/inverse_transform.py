"""Samplers that draw from the variables' distributions, by inverse transform sampling.

The sampler gives every variable a uniform number for each sample, the numbers of correlated variables are mixed, and
the variable's distribution turns the number into a value, moved by the shift of the sample's production batch.
"""

from abc import abstractmethod

from scipy.special import ndtri

from campaign.inputs.sampling.correlation import correlated
from campaign.inputs.sampling.production_batches import quantiles
from campaign.inputs.sampling.sampler import SampledInputs, Sampler, varied
from engine.arrays import Array

EVENLY_SPREAD = (
    "the intervals are those of independent samples. Means and sigmas of responses close to a sum of effects of single "
    "variables are more precise than these intervals (conservative); shares far out in a tail are about as precise."
)


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
