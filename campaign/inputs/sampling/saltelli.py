"""Saltelli's design: two independent samples A and B, and A with one variable at a time taken from B.

A. Saltelli et al., "Variance based sensitivity analysis of model output. Design and estimator for the total sensitivity
index", 2010. Only this design has pairs of runs that differ in one variable alone, which show its interactions.

A and B are the halves of one scrambled Sobol sequence with two dimensions per variable. With k variables, sample s
belongs to row i = s // (k + 2) of the design, and s % (k + 2) selects its run: 0 that of A, 1 that of B, 2 + j that of
A with variable j from B. So more samples keep the first ones, and the rows of A are the samples of sampler sobol.
"""

import numpy as np
from numpy.typing import NDArray

from campaign.inputs.sampling.inverse_transform import EVENLY_SPREAD, InverseTransformSampler
from campaign.inputs.sampling.sampler import SampledInputs, dependence, varied
from campaign.inputs.sampling.sobol import sobol
from engine.arrays import Array

MOST_VARIABLES = 10_600  # each takes two dimensions, and there are direction numbers for 21,201


class Saltelli(InverseTransformSampler):
    """Two samples, and combinations of them that give the variables' total indices."""

    name = "saltelli"
    summary = "Saltelli's design, for total Sobol' indices"
    report = (
        "Saltelli's design: two scrambled Sobol' samples A and B, and copies of A with one variable taken from B. The "
        "copies repeat values and add no independent samples: every statistic, interval, share and tail here is over A "
        "and B alone, 2 of k + 2 runs with k variables; the copies serve the total indices. A and B are evenly "
        f"spread, so {EVENLY_SPREAD}"
    )

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError unless the variables are independent and the samples form a complete design."""
        if key := dependence(inputs):
            raise ValueError(
                f"{key}: sampler saltelli changes one variable at a time, so the variables must be independent;"
                ' remove it, or write sampler = "sobol"'
            )
        if inputs.stop:
            raise ValueError(
                "stop: samples of sampler saltelli repeat each other's values, so they are not independent, and a"
                ' stopping rule cannot judge an interval by them; remove stop, or write sampler = "sobol"'
            )
        k = len(varied(inputs))
        if not 0 < k <= MOST_VARIABLES:
            raise ValueError(
                f"variables: {k} of them vary; sampler saltelli allows 1 to {MOST_VARIABLES}, because each takes two"
                ' dimensions of a Sobol sequence; change their number, or write sampler = "random"'
            )
        sizes = nearest_sizes(k, inputs.samples)
        if inputs.samples not in sizes:
            raise ValueError(
                f"samples = {inputs.samples}: sampler saltelli needs n ({k} + 2) samples for {k} variables, where n is"
                f" a power of 2; write samples = {' or '.join(map(str, sizes))}"
            )

    def uniforms(self, inputs: SampledInputs, names: list[str], first: int, count: int) -> dict[str, Array]:
        """Return the points of A, of B, and of A with one variable from B."""
        return saltelli(inputs.seed, names, first, count)

    def independent(self, inputs: SampledInputs, sample: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which samples belong to A or B, in the shape of ``sample``."""
        return np.asarray(sample % (len(varied(inputs)) + 2) < 2)

    def designed(self, inputs: SampledInputs) -> tuple[str, ...]:
        """Return the variables that vary."""
        return tuple(varied(inputs))


def saltelli(seed: int, names: list[str], first: int, count: int) -> dict[str, Array]:
    """Return samples ``first .. first + count - 1`` of all variables by name, uniform inside (0, 1), each (count,)."""
    width = len(names) + 2
    row, run = np.divmod(np.arange(first, first + count), width)
    begin, end = first // width, (first + count - 1) // width
    of_b = [f"B\n{name}" for name in names]  # scrambles depend on the name, so B's dimensions have their own
    points = sobol(seed, [*names, *of_b], begin, end - begin + 1)
    return {
        name: np.where((run == 1) | (run == 2 + j), points[other][row - begin], points[name][row - begin])
        for j, (name, other) in enumerate(zip(names, of_b, strict=True))
    }


def nearest_sizes(variables: int, samples: int) -> tuple[int, ...]:
    """Return the nearest sizes of a design below and above ``samples``; only ``samples`` if it is such a size.

    A design has ``n (variables + 2)`` samples with n a power of 2, because such a number of Sobol points is evenly
    spread. If ``samples`` is below the smallest design, only the size of that design is returned.
    """
    width = variables + 2
    below = width << max((samples // width).bit_length() - 1, 0)
    return (below,) if samples <= below else (below, 2 * below)
