"""Total-order Sobol' indices: the share that a variable explains with all its interactions, from Saltelli's design.

A row of the design has k + 2 runs: one of sample A, one of sample B, and k of A with one variable taken from B.
First-order indices use the estimator of Saltelli et al. (2010, table 2 b), total-order indices that of Jansen (table
2 f); their difference, row by row, is the share of the variable's interactions. Standard errors come from the
delete-a-group jackknife over rows, as if rows were independent; the errors of evenly spread rows are mostly smaller
(`docs/sensitivity.md`).

The runs of a row share values: only the runs of A and B are independent draws, and only they may be used for other
statistics.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting import format_numbers
from reporting.arrays import ROUNDING, Array, random_rows
from reporting.errors import ReportError
from reporting.samples import Samples
from reporting.sensitivity.first_order import jackknife_error
from reporting.sensitivity.polynomials import GROUPS, total_and_rest
from reporting.spec import ReportSpec

_LISTED = 5  # missing samples listed in a message


@dataclass(frozen=True)
class TotalOrder:
    """Sobol' indices of a response from a design; estimates may lie outside 0 to 1 by chance."""

    variables: tuple[str, ...]  # the k variables of the design
    first_order: Array  # share that each variable explains alone, shape (k,)
    first_order_error: Array
    total: Array  # with all its interactions, shape (k,)
    total_error: Array
    interactions: Array  # total-order minus first-order index, shape (k,)
    interactions_error: Array


def independent_draws(samples: Samples, spec: ReportSpec) -> Samples:
    """Return the independent draws: A and B of a design, the plain runs of importance sampling, or all samples."""
    # ReportError: the samples are a design without variables, or with a variable that the campaign does not have.
    if spec.proposal:
        return samples.where(samples.importance["component"] == 0)
    if spec.designed is None:
        return samples
    unknown = set(spec.designed) - {variable.name for variable in spec.variables}
    if not spec.designed or unknown:
        raise ReportError(
            f"designed = {spec.designed}: a design has one variable or more, each of the campaign's; give the variables"
            " of the design, or None if the samples form no design"
        )
    return samples.where(samples.sample % (len(spec.designed) + 2) < 2)


def total_order(samples: Samples, spec: ReportSpec) -> "dict[str, TotalOrder | str]":
    """Return the indices of every response, or why there are none; ReportError: the samples are not of a design."""
    if not spec.designed:
        return {}
    if samples.sample.size and samples.sample[-1] >= spec.requested:
        raise ReportError(f"sample {samples.sample[-1]}: a design of {spec.requested} samples numbers them from 0")
    at = samples.sample[samples.ok]
    indices: dict[str, TotalOrder | str] = {}
    for response in spec.responses:
        y = np.full(spec.requested, np.nan)
        y[at] = samples.values[response.name][samples.ok]
        missing = np.flatnonzero(~np.isfinite(y))
        indices[response.name] = _why_none(missing, y.size) if missing.size else total_order_indices(y, spec.designed)
    return indices


def total_order_indices(y: Array, variables: Sequence[str]) -> TotalOrder | str:
    """Return the Sobol' indices of a finite response on a design; a text says why there are none.

    `y`, shape (n (k + 2),), is row by row: the run of A, of B, then of A with each of the k variables taken from B in
    turn. ReportError: the values are not those of a design.
    """
    width = len(variables) + 2
    n, rest = divmod(y.size, width)
    if not variables or rest:
        raise ReportError(
            f"total-order indices: {y.size} values for {len(variables)} variables, but a design has"
            f" n ({len(variables)} + 2): give the values of A, B and A with each variable of B, row by row"
        )
    if n < GROUPS:
        return f"No total-order indices: a design of {n} rows is too small, {GROUPS} are needed."
    z = y.reshape(n, width)[random_rows(n)]
    # Centred, because the estimate of first-order indices from products of runs then scatters less.
    z = z - z[:, :2].mean()
    if z[:, :2].std() <= ROUNDING * np.abs(y).max():
        return "No total-order indices, because all values are equal."
    a, b, mixed = z[:, :1], z[:, 1:2], z[:, 2:]
    products = np.hstack([np.ones_like(a), a + b, a * a + b * b, b * (mixed - a), (a - mixed) ** 2 / 2])
    sums = total_and_rest(np.array([products[group::GROUPS].sum(axis=0) for group in range(GROUPS)]))
    means = sums[:, 1:] / sums[:, :1]
    variance = means[:, 1:2] / 2 - (means[:, :1] / 2) ** 2  # only A and B: the other runs share their values
    first, total = np.split(means[:, 2:] / variance, 2, axis=1)
    estimates = [(share[0], jackknife_error(share)) for share in (first, total, total - first)]
    return TotalOrder(tuple(variables), *estimates[0], *estimates[1], *estimates[2])


def _why_none(missing: NDArray[np.intp], requested: int) -> str:
    """Return which samples have no value, and a remedy."""
    first = ", ".join(str(sample) for sample in missing[:_LISTED])
    more = f" and {format_numbers.grouped(missing.size - _LISTED)} more" if missing.size > _LISTED else ""
    return (
        f"No total-order indices: {format_numbers.grouped(missing.size)} of the design's"
        f" {format_numbers.grouped(requested)} samples have no value (sample {first}{more}), and these indices need a"
        " complete design. clearcap resume computes missing samples, clearcap rerun failed ones; the other shares do"
        " not need the design."
    )
