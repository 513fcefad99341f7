"""Importance sampling: most samples are drawn where rejects are expected, and get weights that correct for this.

A sample and its weight follow from the campaign file and the number of the sample alone. Where to draw is a proposal: a
mixture of normal distributions of the variables' standard scores. A variable's standard score z is normal with mean 0
and standard deviation 1, and Phi(z) is the uniform number that its distribution turns into a value. A component of the
mixture moves the centre of the scores, widens them, or both. The shares a0, a1, ... of the components in the samples
give the weight of a sample:

    w(z) = f(z) / (a0 f(z) + a1 q1(z) + a2 q2(z) + ...)

Here f is the density of the scores in production and qk that of component k. The remaining share a0 of the samples is
drawn from f itself, so that no weight exceeds 1 / a0 (the defensive mixture of T. Hesterberg, "Weighted average
importance sampling and defensive mixture distributions", 1995; A. Owen and Y. Zhou, "Safe and effective importance
sampling", 2000). A weighted mean over all samples is unbiased for any components; good components make it precise.
"""

from collections.abc import Mapping
from itertools import accumulate
from math import log
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.special import ndtr, ndtri

from campaign.inputs.distributions.base import DRAWN
from campaign.inputs.sampling.inverse_transform import COMPONENT, InverseTransformSampler, production_batch, uniforms
from campaign.inputs.sampling.sampler import SampledInputs, joint_variables, varied
from engine.arrays import Array
from engine.mechanism.base import TableModel
from engine.mechanism.faults import did_you_mean
from reporting.distributions.forms import exp
from reporting.distributions.forms import log as log_of

LEAST_NOMINAL = 0.05  # share of samples drawn from the distributions themselves; it limits weights to 20
LARGEST_SHIFT = 8.0  # standard scores; a little above it, Phi rounds to 1 in double precision
MOST_COMPONENTS = 100
AIM = 0.75  # of the way to a centre; a component draws many samples beyond this

Shift = Annotated[float, Field(ge=-LARGEST_SHIFT, le=LARGEST_SHIFT, allow_inf_nan=False)]
Scores = dict[str, Array]


class Component(TableModel, strict=True):
    """A component of the mixture: draws a share of the samples where rejects are expected."""

    share: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        description="Share of the samples that it draws, above 0; all shares together at most 0.95."
    )
    shift: dict[Annotated[str, Field(min_length=1, max_length=100)], Shift] = Field(
        default_factory=dict,
        description="Centre of the standard score of each variable, from -8 to 8: 2 draws around the value with 97.7 %"
        " of production below it. 0 for variables that are not named. With correlations it is the centre before the"
        " scores are mixed, in the order of the variables.",
    )
    scale: Annotated[float, Field(ge=0.5, le=5.0)] = Field(
        default=1.0, description="Standard deviation of all standard scores around the centre, from 0.5 to 5."
    )
    source: str = Field(default="", description="What it aims at, or where its numbers come from, in words.")


class Proposal(TableModel, strict=True):
    """Where importance sampling draws; the remaining samples follow the variables' distributions."""

    components: Annotated[tuple[Component, ...], Field(strict=False, min_length=1, max_length=MOST_COMPONENTS)] = Field(
        description="Where rejects are expected: 1 to 100 components with their shares of the samples."
    )

    @model_validator(mode="after")
    def _some_follow_production(self) -> Self:
        if self.nominal < LEAST_NOMINAL - 1e-9:
            raise ValueError(
                f"components: their shares add up to {1.0 - self.nominal:g}; allowed: up to {1.0 - LEAST_NOMINAL:g},"
                " so that weights stay bounded; reduce them"
            )
        return self

    @property
    def nominal(self) -> float:
        """Share of the samples drawn from the distributions themselves."""
        return 1.0 - sum(component.share for component in self.components)


def drawn_from(proposal: Proposal, u: Array) -> NDArray[np.int64]:
    """Return the component that draws each sample, (n,), by its uniform number: 0 for the distributions themselves."""
    ends = list(accumulate((c.share for c in proposal.components), initial=proposal.nominal))
    # the shares may add up to slightly less than 1, and a number above their sum belongs to the last component
    return np.minimum(np.searchsorted(ends, u, side="right"), len(proposal.components)).astype(np.int64)


def moved(proposal: Proposal, component: NDArray[np.int64], scores: Mapping[str, Array]) -> dict[str, Array]:
    """Return the standard scores of each variable, moved and widened by each sample's component; shape (n,) each."""
    scale = np.array([1.0, *(c.scale for c in proposal.components)])[component]
    return {
        name: np.array([0.0, *(c.shift.get(name, 0.0) for c in proposal.components)])[component] + scale * z
        for name, z in scores.items()
    }


def aimed(proposal: Proposal, scores: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Return whether the moved scores of each sample lie beyond 3/4 of the way to the centre of any component."""
    result = np.zeros(next(iter(scores.values())).shape, np.bool_)
    for c in proposal.components:
        beyond = np.zeros(result.shape)
        for name, shift in c.shift.items():
            beyond = beyond + shift * (scores[name] - AIM * shift)
        result |= beyond > 0.0
    return result


def log_weights(proposal: Proposal, scores: Mapping[str, Array]) -> Array:
    """Return the logarithm of the weight of each sample from its moved scores, shape (n,)."""
    # Sums run variable by variable and component by component, so that an element depends, bit for bit, on its own
    # scores alone.
    z = list(scores.values())
    terms = [np.full(z[0].shape, log(proposal.nominal))]
    for c in proposal.components:
        # the logarithm of q_k / f
        ratio = np.full(z[0].shape, log(c.share) - len(z) * log(c.scale))
        for name, x in scores.items():
            away = (x - c.shift.get(name, 0.0)) / c.scale
            ratio = ratio + 0.5 * (x * x - away * away)
        terms.append(ratio)
    largest = terms[0]
    for term in terms[1:]:
        largest = np.maximum(largest, term)
    total = exp(terms[0] - largest)
    for term in terms[1:]:
        total = total + exp(term - largest)
    return -(largest + log_of(total))


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
        for table, (first, *_) in joint_variables(inputs.variables).items():
            raise ValueError(
                f'variables.{first}.joint = "{table}": importance sampling moves standard scores, and rows of a table'
                ' have none; write sampler = "random"'
            )
        if inputs.stop:
            raise ValueError(
                "stop: a stopping rule judges all samples alike, but those of sampler importance have weights; remove"
                " stop, and see in the report whether the share is known well enough"
            )
        names = varied(inputs)
        for number, component in enumerate(_proposal(inputs).components):
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
    assert isinstance(inputs.importance, Proposal)
    return inputs.importance


def _component(inputs: SampledInputs, first: int, count: int) -> NDArray[np.int64]:
    """Return the component that draws each sample, shape (count,)."""
    return drawn_from(_proposal(inputs), uniforms(inputs.seed, "", first, count, COMPONENT))


def _scores(inputs: SampledInputs, names: list[str], first: int, count: int) -> Scores:
    """Return the standard scores of samples ``first .. first + count - 1`` by variable, before correlations."""
    nominal = {name: ndtri(uniforms(inputs.seed, name, first, count)) for name in names}
    return moved(_proposal(inputs), _component(inputs, first, count), nominal)
