"""Independent random samples."""

from campaign.inputs.sampling.inverse_transform import InverseTransformSampler
from campaign.inputs.sampling.sampler import SampledInputs
from campaign.inputs.sampling.streams import uniforms
from engine.arrays import Array


class RandomSampler(InverseTransformSampler):
    """Each sample is drawn independently of all others."""

    name = "random"
    summary = "independent random samples"
    report = "Independent random samples, as the intervals assume."
    ordered = False

    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return a random number for each variable and sample."""
        return {name: uniforms(inputs.seed, name, first, count) for name in names}
