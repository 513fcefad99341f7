"""Correlated variables: a Gaussian copula, given by Spearman's rank correlations.

The uniform numbers of correlated variables are transformed to normal scores, the scores are mixed, and the mixed scores
are transformed back to uniform numbers, so every variable keeps its distribution. A rank correlation r does not depend
on the distributions; the correlation of the scores is 2 sin(pi r / 6) (K. Pearson, "On further methods of determining
correlation", 1907).
"""

from collections import Counter
from collections.abc import Mapping
from functools import lru_cache
from math import pi, sin, sqrt

import numpy as np
from scipy.special import ndtr, ndtri

from campaign.inputs.distributions import Constant
from campaign.inputs.sampling.sampler import Correlations, SampledInputs
from engine.arrays import Array
from engine.mechanism.faults import did_you_mean

LEAST_EIGENVALUE = 1e-9  # of the scores' correlation matrix; below it, one variable is a function of the others
LARGEST = 1.0 - 2.0**-53  # uniform number: the double next to 1


def check_correlations(inputs: SampledInputs) -> None:
    """Raise ValueError for correlations of no two variables that vary, given twice, or that contradict each other."""
    pairs = Counter(frozenset((a, b)) for a, b, _ in inputs.correlations or ())
    for a, b, rank in inputs.correlations or ():
        entry = f'correlations, ["{a}", "{b}", {rank:g}]'
        for name in (a, b):
            if name not in inputs.variables:
                names = list(inputs.variables)
                raise ValueError(f"{entry}: no variable {name}; allowed: {', '.join(names)}{did_you_mean(name, names)}")
            if isinstance(inputs.variables[name], Constant):
                raise ValueError(f"{entry}: {name} is a constant and cannot be correlated; remove the entry")
        if a == b:
            raise ValueError(f"{entry}: a variable cannot be correlated with itself; name two variables")
        if pairs[frozenset((a, b))] > 1:
            raise ValueError(f"{entry}: this pair is given more than once; keep one entry")
    if inputs.correlations and (smallest := smallest_eigenvalue(inputs.correlations)) < LEAST_EIGENVALUE:
        raise ValueError(
            f"correlations: contradict each other, their matrix is not positive definite (smallest eigenvalue"
            f" {smallest:.3g}); multiply all of them by at most {largest_scale(inputs.correlations):g}"
        )


def correlated(u: Mapping[str, Array], correlations: Correlations) -> dict[str, Array]:
    """Return the uniform numbers of the correlated variables, mixed in the order of ``u``; shapes stay the same."""
    names = [name for name in u if any(name in pair for pair in correlations)]
    scores, mixed = [ndtri(u[name]) for name in names], {names[0]: u[names[0]]}
    for name, row in zip(names[1:], _factor(tuple(names), correlations)[1:], strict=True):
        # a plain sum: the bits of a matrix product depend on the number of samples
        score = sum(share * z for share, z in zip(row, scores, strict=False) if share)
        mixed[name] = np.clip(ndtr(score), 1.0 - LARGEST, LARGEST)
    return mixed


def matrix(names: tuple[str, ...], correlations: Correlations, scale: float = 1.0) -> Array:
    """Return the correlation matrix of the normal scores, shape (k, k), with all rank correlations scaled."""
    result, at = np.eye(len(names)), {name: i for i, name in enumerate(names)}
    for a, b, rank in correlations:
        result[at[a], at[b]] = result[at[b], at[a]] = 2.0 * sin(pi * scale * rank / 6.0)
    return result


def smallest_eigenvalue(correlations: Correlations, scale: float = 1.0) -> float:
    """Return the smallest eigenvalue of the scores' correlation matrix."""
    names = tuple(dict.fromkeys(name for a, b, _ in correlations for name in (a, b)))
    return float(np.linalg.eigvalsh(matrix(names, correlations, scale))[0])


def largest_scale(correlations: Correlations) -> float:
    """Return the largest factor from 0 to 1, in steps of 0.01, that makes all correlations together possible."""
    return next(
        (n / 100 for n in range(100, 0, -1) if smallest_eigenvalue(correlations, n / 100) >= LEAST_EIGENVALUE), 0.0
    )


@lru_cache(maxsize=8)
def _factor(names: tuple[str, ...], correlations: Correlations) -> tuple[tuple[float, ...], ...]:
    """Return the rows of the lower Cholesky factor; plain arithmetic, as a library's blocking would change bits."""
    rows: list[tuple[float, ...]] = []
    for i, target in enumerate(matrix(names, correlations).tolist()):
        row: list[float] = []
        for j in range(i):
            product = sum(a * b for a, b in zip(row, rows[j], strict=False))
            row.append((target[j] - product) / rows[j][j])
        row.append(sqrt(1.0 - sum(a * a for a in row)))
        rows.append(tuple(row))
    return tuple(rows)
