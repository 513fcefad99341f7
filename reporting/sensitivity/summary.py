"""The sensitivity of responses to variables, by every measure, from the given samples.

Linear and rank regression (`regression`), first-order Sobol' indices and conditional expectations (`first_order`),
total-order indices if the samples are a design (`total_order`), common properties of rejects, and the worst samples
(`rejects`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting import format_numbers
from reporting.arrays import Array
from reporting.capability.lots import LEAST_LOTS
from reporting.errors import ReportError
from reporting.sensitivity.first_order import jackknife_quantile
from reporting.sensitivity.influence import (
    CORRELATED,
    FEWEST_CARRIERS,
    OPEN,
    RANKS,
    Influence,
    ResponseSensitivity,
    Sensitivity,
    as_share,
    influence_of,
    needed_errors,
    response_verdict,
    with_shapley,
    with_total_effect,
    with_total_order,
)
from reporting.sensitivity.measures import CRITICAL_SHARE, Measures, fewest_rows, measure, varies
from reporting.sensitivity.regression import MOST_SHARED
from reporting.sensitivity.reject_attribution import reject_attribution
from reporting.sensitivity.rejects import reject_causes, worst_samples
from reporting.sensitivity.total_order import TotalOrder
from reporting.sensitivity.unexplained import Known, Unexplained, note_on, split, without_scatter


def sensitivity(
    variables: Mapping[str, ArrayLike],
    responses: Mapping[str, ArrayLike],
    limits: Mapping[str, tuple[float | None, float | None]] | None = None,
    sample: NDArray[np.int64] | None = None,
    confidence: float = 0.95,
    known: Mapping[str, Known] | None = None,
    correlations: Sequence[tuple[str, str, float]] | None = None,
    lots: NDArray[np.int64] | None = None,
) -> Sensitivity:
    """Return the sensitivity of each response to the variables, by every measure.

    Columns of one table, shape (n,): a row is used for a response if all variables and this response are finite.
    `sample` are the sample numbers, by default the row numbers. `known` has what is not in these columns: total-order
    indices of a design, scatter of repeats. `correlations` are the requested ones; if not given, the samples decide
    whether variables are correlated. The shifts of `lots` correlate variables by chance. ReportError: the columns
    differ in length.
    """
    inputs = {name: np.asarray(column, np.float64) for name, column in variables.items()}
    outputs = {name: np.asarray(column, np.float64) for name, column in responses.items()}
    n = _length(inputs | outputs)
    sample = np.arange(n) if sample is None else sample
    complete = np.ones(n, np.bool_)
    for column in inputs.values():
        complete &= np.isfinite(column)
    rows = {name: complete & np.isfinite(column) for name, column in outputs.items()}
    done: dict[str, ResponseSensitivity] = {}
    # Responses with values in the same rows share one pass over them.
    for names in _same_rows(rows):
        at = rows[names[0]]
        columns = {name: column[at] for name, column in inputs.items()}
        values = {name: outputs[name][at] for name in names}
        of_rows = None if lots is None else lots[at]
        count = None if of_rows is None else np.unique(of_rows).size
        measures = measure(columns, values, confidence, correlations, of_rows)
        for name in names:
            lsl, usl = (limits or {}).get(name, (None, None))
            more = (known or {}).get(name, Known())
            found = _response(name, columns, values[name], sample[at], (lsl, usl), measures, more, confidence)
            out = _out_of_limits(values[name], lsl, usl)
            costs = reject_attribution(columns, out, confidence, of_rows) if np.any(out) else None
            done[name] = replace(found, attribution=costs, notes=(*found.notes, *_of_lots(count, int(at.sum()))))
    return Sensitivity(tuple(inputs), tuple(done[name] for name in outputs))


def _response(
    name: str,
    columns: dict[str, Array],
    y: Array,
    sample: NDArray[np.int64],
    limits: tuple[float | None, float | None],
    measures: Measures | None,
    known: Known,
    confidence: float,
) -> ResponseSensitivity:
    """Return the sensitivity of one response."""
    worst = worst_samples(sample, y, columns, *limits)
    varying = {v: column for v, column in columns.items() if varies(column)}
    constant = [v for v in columns if v not in varying]
    notes = [f"{v} does not vary, so no response can depend on it." for v in constant if y.size]
    if measures is None or name not in measures.responses:
        return ResponseSensitivity(
            name, y.size, None, None, None, None, None, None, tuple(map(Influence, columns)), OPEN, None, worst,
            (*notes, _why_nothing(y, len(varying))),
        )  # fmt: skip
    at, quantile = measures.responses[name], jackknife_quantile(measures.groups, confidence)
    shares, shapley = measures.effects, measures.shapley
    unexplained, error = float(shares.unexplained[at]), float(shares.unexplained_error[at])
    if shapley is not None:
        unexplained, error = float(shapley.interaction[at]), float(shapley.interaction_error[at])
    together = measures.totals.get(at)
    # Both overstate interactions by what their functions of single variables miss, and neither knows its own bias.
    if together is not None:
        unexplained = min(unexplained, float(together.interaction[0]))
        error = max(error, float(together.interaction_error[0]))
    left_over = split(unexplained, quantile * error, known)
    totals = without_scatter(known.totals, known, quantile) if isinstance(known.totals, TotalOrder) else None
    scatter = left_over.scatter or 0.0
    influences = tuple(influence_of(v, at, measures, left_over.most_interactions, confidence) for v in columns)
    influences = tuple(with_total_effect(i, at, measures, scatter, confidence) for i in influences)
    influences = tuple(with_shapley(i, at, measures, scatter, confidence) for i in influences)
    if totals is not None:
        influences = tuple(with_total_order(i, totals, confidence) for i in influences)
    uncovered = left_over.most_interactions
    if shapley is not None:
        uncovered = split(
            float(shapley.remainder[at]), quantile * float(shapley.remainder_error[at]), known
        ).most_interactions
    elif together is not None:
        uncovered = split(
            float(together.remainder[0]), quantile * float(together.remainder_error[0]), known
        ).most_interactions
    return ResponseSensitivity(
        response=name,
        n=y.size,
        independent=measures.independent,
        degree=int(shares.degree[at]),
        r2=float(measures.linear.r2[at]),
        r2_rank=float(measures.rank.r2[at]),
        interaction=as_share(unexplained),
        interaction_interval=left_over.interval,
        influences=influences,
        verdict=response_verdict(influences, uncovered if totals is None else 0.0),
        rejects=reject_causes(y, varying, *limits, confidence),
        worst=worst,
        notes=(
            *notes,
            *(() if totals else _by_products(measures, at, confidence)),
            *_notes(measures, at, left_over, known),
            *_only_correlated(influences),
            *_interacting(influences, totals, confidence),
            *_carried(influences),
        ),
        scatter=left_over.scatter,
        scatter_interval=left_over.scatter_interval,
        rest=left_over.rest,
        rest_interval=left_over.rest_interval,
    )


def _of_lots(lots: int | None, n: int) -> tuple[str, ...]:
    """Return the effect of production lots on the intervals."""
    if lots is None or lots == n:
        return ()
    come = f"The samples of each of the {format_numbers.grouped(lots)} production lots share a shift. The intervals"
    if lots < LEAST_LOTS:
        return (f"{come} of the shares treat them as independent and are too narrow.",)
    return (f"{come} of the shares allow for this, those of rank correlations do not.",)


def _out_of_limits(y: Array, lsl: float | None, usl: float | None) -> NDArray[np.bool_]:
    """Return which values are rejects."""
    below = y < (-np.inf if lsl is None else lsl)
    return np.asarray(below | (y > (np.inf if usl is None else usl)))


def _notes(measures: Measures, at: int, found: Unexplained, known: Known) -> tuple[str, ...]:
    """Return cautions about the numbers of a response."""
    collinear = [v for v, i in measures.variables.items() if not np.isfinite(measures.linear.inflation[i])]
    shapley = measures.shapley
    left = 0.0 if shapley is None else float(shapley.remainder[at]) - (found.scatter or 0.0)
    together = note_on(found, known, independent=measures.independent)
    notes = (
        (
            not measures.independent and shapley is not None,
            "The variables are correlated: first-order indices overlap and need not add up to 1. The verdicts follow"
            " from Shapley effects, which do, and from what a variable moves while the others are fixed.",
        ),
        (
            not measures.independent and shapley is None,
            f"The variables are correlated, and Shapley effects take at most {MOST_SHARED} variables: no verdict.",
        ),
        (
            bool(collinear),
            f"{', '.join(collinear)}: determined by the other variables, so coefficients are not unique.",
        ),
        (bool(together) and (shapley is None or float(shapley.remainder[at]) >= CRITICAL_SHARE), together),
        (
            left >= CRITICAL_SHARE,
            f"{100 * left:.0f} % of the variance is in no Shapley effect, because the regression does not capture it;"
            " it widens the intervals.",
        ),
        (isinstance(known.totals, str), str(known.totals)),
    )
    return tuple(text for holds, text in notes if holds)


def _interacting(influences: tuple[Influence, ...], totals: TotalOrder | None, confidence: float) -> tuple[str, ...]:
    """Return the variables whose interactions explain at least a tenth of the variance, beyond chance."""
    if totals is None:
        return ()
    bars = needed_errors(len(totals.variables), confidence) * totals.interactions_error
    significant = dict(zip(totals.variables, totals.interactions > bars, strict=True))
    shares = [
        f"{i.variable} explains {100 * i.total:.0f} % with them and {100 * (i.first_order or 0.0):.0f} % alone"
        for i in influences
        if i.total is not None and (i.interactions or 0.0) >= CRITICAL_SHARE and significant[i.variable]
    ]
    return (f"Variables that act together with others: {', '.join(shares)}.",) if shares else ()


def _by_products(measures: Measures, at: int, confidence: float) -> tuple[str, ...]:
    """Return the variables whose interactions in pairs explain at least a tenth of the variance, beyond chance."""
    found, alone = measures.totals.get(at), measures.effects.share[at]
    if found is None:
        return ()
    bars = needed_errors(len(measures.variables), confidence, measures.groups) * found.total_error[0]
    more = found.total[0] - np.maximum(alone, 0.0)
    shares = [
        f"{v} explains {100 * as_share(float(found.total[0, i])):.0f} % with them and"
        f" {100 * as_share(float(alone[i])):.0f} % alone"
        for v, i in measures.variables.items()
        if more[i] >= max(CRITICAL_SHARE, bars[i])
    ]
    by = "By a regression with products of two, variables act together with others"
    return (f"{by}: {', '.join(shares)}.",) if shares else ()


def _only_correlated(influences: tuple[Influence, ...]) -> tuple[str, ...]:
    """Return which variables have a share only because they are correlated with others, and with which."""
    return tuple(
        f"{i.variable} has {100 * (i.shapley or 0.0):.0f} % only through its correlation with"
        f" {', '.join(i.through) or 'the others'}: while the others are fixed it moves nothing."
        for i in influences
        if i.verdict == CORRELATED
    )


def _carried(influences: tuple[Influence, ...]) -> tuple[str, ...]:
    """Return which shares are rank-based, and which are carried by a few samples."""
    ranks = [i.variable for i in influences if i.estimator == RANKS and (i.first_order or 0.0) >= CRITICAL_SHARE]
    jumps = f"{', '.join(ranks)}: the response jumps or bends too sharply for a polynomial, so ranks are used."
    few = [
        f"{i.variable}: about {max(round(i.carriers), 1)} samples determine its share, so its interval is too narrow."
        for i in influences
        if i.carriers is not None and i.carriers < FEWEST_CARRIERS and (i.first_order or 0.0) >= CRITICAL_SHARE / 2
    ]
    return (*((jumps,) if ranks else ()), *few)


def _why_nothing(y: Array, variables: int) -> str:
    """Return why a response has no measures of sensitivity."""
    needed = fewest_rows(max(variables, 1))
    if y.size < needed:
        return (
            f"{y.size} samples are too few for the sensitivity to {variables} variables: at least {needed} are needed."
        )
    if not varies(y):
        return "All values are equal: no variable moves this response."
    return "No variable varies."


def _same_rows(rows: dict[str, NDArray[np.bool_]]) -> list[list[str]]:
    """Return the names of the columns, grouped by identical rows."""
    groups: dict[bytes, list[str]] = {}
    for name, at in rows.items():
        groups.setdefault(np.packbits(at).tobytes(), []).append(name)
    return list(groups.values())


def _length(columns: dict[str, Array]) -> int:
    """Return the common length of the columns; raise ReportError if they differ."""
    if not columns:
        return 0
    shape = next(iter(columns.values())).shape
    wrong = [name for name, column in columns.items() if column.shape != shape or column.ndim != 1]
    if wrong:
        raise ReportError(
            f"sensitivity: {', '.join(wrong)}: differs in length from the others; give columns of one table"
        )
    return int(shape[0])
