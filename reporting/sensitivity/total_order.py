"""Total Sobol' indices: what a variable explains with all its interactions, from Saltelli's design.

A row of the design has k + 2 runs: one of sample A, one of sample B, and k of A with one variable of B's. First-order
indices by Saltelli et al. (2010, table 2 b), total ones by Jansen (table 2 f); their difference, row by row, is the
variable's share in interactions. Errors come from the delete-a-group jackknife over rows, as if these were independent;
evenly spread ones are mostly closer (`docs/sensitivity.md`).

Runs of a row repeat each other's values: only those of A and B are draws by themselves, and only they may enter a
statistic.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from reporting import format_numbers as numbers
from reporting.arrays import Array, random_rows
from reporting.capability.moments import ROUNDING
from reporting.errors import ReportError
from reporting.samples import Samples
from reporting.sensitivity.first_order import jackknife_error
from reporting.sensitivity.polynomials import GROUPS, total_and_rest
from reporting.spec import ReportSpec

_NAMED = 5  # samples of a hole


@dataclass(frozen=True)
class TotalOrder:
    """Shares of a response's variance from a design; estimates may leave 0 to 1 by chance.

    Attributes
    ----------
    variables : tuple of str
        The k variables of the design.
    first_order, first_order_error : array, shape (k,)
        What each explains alone, and its standard error.
    total, total_error : array, shape (k,)
        What each explains with all its interactions.
    interactions, interactions_error : array, shape (k,)
        Total less first-order index.
    """

    variables: tuple[str, ...]
    first_order: Array
    first_order_error: Array
    total: Array
    total_error: Array
    interactions: Array
    interactions_error: Array


def independent_draws(samples: Samples, spec: ReportSpec) -> Samples:
    """Return the samples that are draws by themselves: of a design those of A and B, otherwise all.

    Raises
    ------
    ReportError
        The samples are a design without variables, or of a variable that the campaign does not have.
    """
    if spec.designed is None:
        return samples
    unknown = set(spec.designed) - {variable.name for variable in spec.variables}
    if not spec.designed or unknown:
        raise ReportError(
            f"designed = {spec.designed}: a design has one variable or more, each of the campaign's; give the variables"
            " of the design, or None where the samples are no design"
        )
    kept = samples.sample % (len(spec.designed) + 2) < 2
    columns = ("sample", "status", "ok", "max_residual", "max_penetration", "settled")
    return replace(
        samples,
        **{name: getattr(samples, name)[kept] for name in columns},
        production_batch=None if samples.production_batch is None else samples.production_batch[kept],
        values={name: column[kept] for name, column in samples.values.items()},
    )


def total_order(samples: Samples, spec: ReportSpec) -> "dict[str, TotalOrder | str]":
    """Return the indices of every response, or in words why there are none; nothing where there is no design.

    Raises
    ------
    ReportError
        The samples are not those of a design.
    """
    if not spec.designed:
        return {}
    if samples.sample.size and samples.sample[-1] >= spec.requested:
        raise ReportError(f"sample {samples.sample[-1]}: a design of {spec.requested} samples numbers them from 0")
    at = samples.sample[samples.ok]
    found: dict[str, TotalOrder | str] = {}
    for response in spec.responses:
        y = np.full(spec.requested, np.nan)
        y[at] = samples.values[response.name][samples.ok]
        holes = np.flatnonzero(~np.isfinite(y))
        found[response.name] = _why_none(holes, y.size) if holes.size else total_order_indices(y, spec.designed)
    return found


def total_order_indices(y: Array, variables: Sequence[str]) -> TotalOrder | str:
    """Return the Sobol' indices of a response on a design.

    Parameters
    ----------
    y : array, shape (n (k + 2),)
        The response, finite, row by row: A's run, B's, then A's with each variable of B's in turn.
    variables : sequence of str
        The k variables in that order.

    Returns
    -------
    TotalOrder or str
        In words why there are none: too few rows, or all values are equal.

    Raises
    ------
    ReportError
        The values are not those of a design.
    """
    width = len(variables) + 2
    n, rest = divmod(y.size, width)
    if not variables or rest:
        raise ReportError(
            f"designed indices: {y.size} values for {len(variables)} variables; a design has n ({len(variables)} + 2):"
            " give the values of A, B and A with each variable of B's, row by row"
        )
    if n < GROUPS:
        return f"No total indices: a design of {n} rows is too small, {GROUPS} are needed."
    z = y.reshape(n, width)[random_rows(n)]
    z = z - z[:, :2].mean()
    if z[:, :2].std() <= ROUNDING * np.abs(y).max():
        return "No total indices: all values are equal."
    a, b, mixed = z[:, :1], z[:, 1:2], z[:, 2:]
    products = np.hstack([np.ones_like(a), a + b, a * a + b * b, b * (mixed - a), (a - mixed) ** 2 / 2])
    sums = total_and_rest(np.array([products[group::GROUPS].sum(axis=0) for group in range(GROUPS)]))
    means = sums[:, 1:] / sums[:, :1]
    variance = means[:, 1:2] / 2 - (means[:, :1] / 2) ** 2  # of A and B: the other runs repeat their values
    first, total = np.split(means[:, 2:] / variance, 2, axis=1)
    found = [(share[0], jackknife_error(share)) for share in (first, total, total - first)]
    return TotalOrder(tuple(variables), *found[0], *found[1], *found[2])


def _why_none(holes: NDArray[np.intp], requested: int) -> str:
    """Return which samples are missing, and what to do."""
    told = ", ".join(str(sample) for sample in holes[:_NAMED])
    more = f" and {numbers.grouped(holes.size - _NAMED)} more" if holes.size > _NAMED else ""
    return (
        f"No total indices: {numbers.grouped(holes.size)} of the design's {numbers.grouped(requested)} samples have no"
        f" value (sample {told}{more}), and a design with a hole is none. clearcap resume computes what is missing,"
        " clearcap rerun what failed; shares alone do not need the design."
    )
