"""Importance sampling: most samples are drawn where rejects are expected, and get weights that correct for this.

A sample and its weight follow from the campaign file and the number of the sample alone; see `proposal`.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from campaign.inputs.distributions.base import DRAWN
from campaign.inputs.sampling.inverse_transform import InverseTransformSampler, production_batch
from campaign.inputs.sampling.proposal import Proposal, aimed, drawn_from, log_weights, moved
from campaign.inputs.sampling.sampler import SampledInputs, varied
from campaign.inputs.sampling.streams import COMPONENT, uniforms
from engine.arrays import Array
from engine.mechanism.faults import did_you_mean

Scores = dict[str, Array]


class ImportanceSampler(InverseTransformSampler):
    """Samples are drawn from a mixture that favours rejects; each has a weight."""

    name = "importance"
    summary = "importance sampling: most samples where rejects are expected, weighted, for shares of some ppm"
    report = (
        "Importance sampling: some runs are drawn from the variables' distributions, independently, and all statistics"
        " and intervals here are over these alone. The others are drawn where rejects are expected; with their weights"
        " they serve the section Rare rejects."
    )
    own_key = "importance"
    columns = ("component", "log_weight", "aimed")

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError unless a proposal names variables that vary and every sample has a weight of its own."""
        if inputs.importance is None:
            raise ValueError(
                "importance: missing; it says where rejects are expected: clearcap design writes it from the rows of"
                " another campaign, or give [[importance.components]] with share and shift"
            )
        if production_batch(inputs, np.zeros(1, np.int64)) is not None:
            raise ValueError(
                "variables: parts of a production batch share a shift, and importance sampling weighs single parts;"
                ' remove batch, or write sampler = "random"'
            )
        if inputs.stop:
            raise ValueError(
                "stop: a stopping rule judges all samples alike, but those of sampler importance have weights; remove"
                " stop, and see in the report whether the share is known well enough"
            )
        names = varied(inputs)
        for number, component in enumerate(inputs.importance.components):
            for name in component.shift:
                if name not in names:
                    raise ValueError(
                        f"importance.components.{number}.shift.{name}: no variable of this name varies; allowed:"
                        f" {', '.join(names)}{did_you_mean(name, names)}"
                    )

    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return the uniform numbers of sampler ``random``, moved as each sample's component requires."""
        component = _component(inputs, first, count)
        nominal = {name: uniforms(inputs.seed, name, first, count) for name in names}
        return {
            name: np.where(component == 0, nominal[name], np.clip(ndtr(z), *DRAWN))
            for name, z in _scores(inputs, names, first, count).items()
        }

    def independent(self, inputs: SampledInputs, sample: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which samples are drawn from the distributions themselves, in the shape of ``sample``."""
        return np.asarray(self.own_columns(inputs, sample)["component"] == 0)

    def own_columns(self, inputs: SampledInputs, sample: NDArray[np.int64]) -> dict[str, NDArray[np.generic]]:
        """Return each sample's component, the logarithm of its weight, and whether any component aims there."""
        first = int(sample.min()) if sample.size else 0
        count = int(sample.max()) + 1 - first if sample.size else 0
        proposal, scores = _proposal(inputs), _scores(inputs, varied(inputs), first, count)
        columns = (_component(inputs, first, count), log_weights(proposal, scores), aimed(proposal, scores))
        return {name: x[sample - first] for name, x in zip(self.columns, columns, strict=True)}


def _proposal(inputs: SampledInputs) -> Proposal:
    """Return the proposal of a checked campaign."""
    if inputs.importance is None:
        raise ValueError("importance: missing; sampler importance draws from it")
    return inputs.importance


def _component(inputs: SampledInputs, first: int, count: int) -> NDArray[np.int64]:
    """Return the component that draws each sample, shape (count,)."""
    return drawn_from(_proposal(inputs), uniforms(inputs.seed, "", first, count, COMPONENT))


def _scores(inputs: SampledInputs, names: list[str], first: int, count: int) -> Scores:
    """Return the standard scores of samples ``first .. first + count - 1`` by variable, before correlations."""
    nominal = {name: ndtri(uniforms(inputs.seed, name, first, count)) for name in names}
    return moved(_proposal(inputs), _component(inputs, first, count), nominal)
