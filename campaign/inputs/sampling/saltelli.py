"""Saltelli's design: two independent samples A and B, and A with one variable at a time taken from B.

A. Saltelli et al., "Variance based sensitivity analysis of model output. Design and estimator for the total sensitivity
index", 2010. The only samples that show what a variable does together with others: two runs that differ in it alone.
A and B are the halves of one scrambled Sobol sequence with two dimensions a variable. With k variables, sample s
belongs to row i = s // (k + 2) of the design; s % (k + 2) says which of its runs it is: 0 A's, 1 B's, 2 + j A's with
variable j of B. So more samples keep the first ones, and a row of A is that of sampler sobol.
"""

import numpy as np

from campaign.inputs.distributions import Array
from campaign.inputs.sampling.sobol import sobol

MOST_VARIABLES = 10_600  # two dimensions each, and 21,201 have direction numbers


def saltelli(seed: int, names: list[str], first: int, count: int) -> dict[str, Array]:
    """Return samples ``first .. first + count - 1`` of all variables by name, uniform inside (0, 1), each (count,)."""
    width = len(names) + 2
    row, run = np.divmod(np.arange(first, first + count), width)
    begin, end = first // width, (first + count - 1) // width
    of_b = [f"B\n{name}" for name in names]  # names key the scrambles: B's dimensions have their own
    points = sobol(seed, [*names, *of_b], begin, end - begin + 1)
    return {
        name: np.where((run == 1) | (run == 2 + j), points[other][row - begin], points[name][row - begin])
        for j, (name, other) in enumerate(zip(names, of_b, strict=True))
    }


def nearest_sizes(variables: int, samples: int) -> tuple[int, ...]:
    """Return the numbers of samples nearest to one that a design can have; that one alone if it can.

    A design has ``n (variables + 2)`` samples with n a power of 2, to which a Sobol sequence is even.
    """
    width = variables + 2
    below = width << max((samples // width).bit_length() - 1, 0)
    return (below,) if samples <= below else (below, 2 * below)
