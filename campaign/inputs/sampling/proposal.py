"""The proposal of importance sampling: a mixture of normal distributions of the variables' standard scores.

A variable's standard score z is normal with mean 0 and deviation 1, and Phi(z) is the uniform number that its
distribution turns into a value. A component of the mixture moves the centre of the scores, widens them, or both. With
the share of each component in the samples known, the weight of a sample is known, too:

    w(z) = f(z) / (a0 f(z) + a1 q1(z) + a2 q2(z) + ...)

f is the density of the scores in production. The rest of the samples, a0, is drawn from f itself, so that no weight
exceeds 1 / a0 (the defensive mixture of T. Hesterberg, "Weighted average importance sampling and defensive mixture
distributions", 1995; A. Owen and Y. Zhou, "Safe and effective importance sampling", 2000). The mean of a weighted
number over all samples is without bias, whatever the components are; good components make it precise.
"""

from collections.abc import Mapping
from itertools import accumulate
from math import log
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from campaign.inputs.distributions.elementary import exp
from campaign.inputs.distributions.elementary import log as log_of
from engine.arrays import Array
from engine.mechanism.base import TableModel

LEAST_NOMINAL = 0.05  # share of samples drawn from the distributions themselves: weights are at most 20
LARGEST_SHIFT = 8.0  # standard scores: double precision ends a little beyond
MOST_COMPONENTS = 100
AIM = 0.75  # of the way to a centre: beyond, a component would have drawn many

Shift = Annotated[float, Field(ge=-LARGEST_SHIFT, le=LARGEST_SHIFT, allow_inf_nan=False)]


class Component(TableModel, strict=True):
    """A part of the samples, drawn where rejects are expected."""

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
    """Where importance sampling draws; the samples that are left over follow the variables' distributions."""

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
        """Share of the samples that are drawn from the distributions themselves."""
        return 1.0 - sum(component.share for component in self.components)


def drawn_from(proposal: Proposal, u: Array) -> NDArray[np.int64]:
    """Return the component that draws each sample: 0 the distributions themselves, k the component number k, from 1.

    Parameters
    ----------
    proposal : Proposal
        The mixture.
    u : array, shape (n,)
        A uniform number of each sample, inside (0, 1).
    """
    ends = list(accumulate((c.share for c in proposal.components), initial=proposal.nominal))
    return np.minimum(np.searchsorted(ends, u, side="right"), len(proposal.components)).astype(np.int64)


def moved(proposal: Proposal, component: NDArray[np.int64], scores: Mapping[str, Array]) -> dict[str, Array]:
    """Return the standard scores of each variable as its sample's component moves and widens them; shape (n,) each."""
    scale = np.array([1.0, *(c.scale for c in proposal.components)])[component]
    return {
        name: np.array([0.0, *(c.shift.get(name, 0.0) for c in proposal.components)])[component] + scale * z
        for name, z in scores.items()
    }


def aimed(proposal: Proposal, scores: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Return whether the moved scores of each sample lie beyond three quarters of the way to a component's centre."""
    result = np.zeros(next(iter(scores.values())).shape, np.bool_)
    for c in proposal.components:
        beyond = np.zeros(result.shape)
        for name, shift in c.shift.items():
            beyond = beyond + shift * (scores[name] - AIM * shift)
        result |= beyond > 0.0
    return result


def log_weights(proposal: Proposal, scores: Mapping[str, Array]) -> Array:
    """Return the logarithm of the weight of each sample, from its moved scores, shape (n,).

    Sums go variable by variable and component by component, so an element depends on its own scores alone, to the bit.
    """
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
