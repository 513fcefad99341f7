"""Which variable moves which response: every measure of it, from the sample the campaign has already paid for.

Linear and rank regression (`regression`), first-order Sobol' indices and conditional expectations (`first_order`),
total-order indices where samples are a design (`total_order`), what rejects have in common and the worst samples
(`rejects`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting.arrays import Array, random_rows
from reporting.capability.intervals import Interval
from reporting.errors import ReportError
from reporting.sensitivity.first_order import Effects, effects, jackknife_quantile, most_degree
from reporting.sensitivity.influence import (
    CRITICAL,
    CRITICAL_SHARE,
    NEGLIGIBLE_SHARE,
    NOT_CRITICAL,
    OPEN,
    Influence,
    ResponseSensitivity,
    Sensitivity,
)
from reporting.sensitivity.polynomials import GROUPS, group_sums
from reporting.sensitivity.regression import Linear, Rank, linear, rank
from reporting.sensitivity.rejects import reject_causes, worst_samples
from reporting.sensitivity.total_order import TotalOrder

_ROUNDING = 8 * float(np.finfo(np.float64).eps)


def sensitivity(
    variables: Mapping[str, ArrayLike],
    responses: Mapping[str, ArrayLike],
    limits: Mapping[str, tuple[float | None, float | None]] | None = None,
    sample: NDArray[np.int64] | None = None,
    confidence: float = 0.95,
    designed: Mapping[str, TotalOrder | str] | None = None,
) -> Sensitivity:
    """Return what moves every response.

    Parameters
    ----------
    variables, responses : mapping of str to array_like, each of shape (n,)
        Columns of one table; a row counts for a response where all variables and this response are finite.
    limits : mapping of str to (lsl, usl), optional
        Limits by response, None where a side is free.
    sample : array of int64, shape (n,), optional
        Numbers of the samples; the rows' by default.
    confidence : float
        Of all intervals.
    designed : mapping of str to TotalOrder or str, optional
        Total indices by response, or why there are none.

    Raises
    ------
    ReportError
        Columns of different lengths.
    """
    inputs = {name: np.asarray(column, np.float64) for name, column in variables.items()}
    outputs = {name: np.asarray(column, np.float64) for name, column in responses.items()}
    n = _length(inputs | outputs)
    sample = np.arange(n) if sample is None else sample
    known = np.ones(n, np.bool_)
    for column in inputs.values():
        known &= np.isfinite(column)
    rows = {name: known & np.isfinite(column) for name, column in outputs.items()}
    done: dict[str, ResponseSensitivity] = {}
    for names in _same_rows(rows):
        at = rows[names[0]]
        columns = {name: column[at] for name, column in inputs.items()}
        values = {name: outputs[name][at] for name in names}
        found = _measure(columns, values, confidence)
        for name in names:
            lsl, usl = (limits or {}).get(name, (None, None))
            told = (designed or {}).get(name)
            done[name] = _response(name, columns, values[name], sample[at], (lsl, usl), found, told, confidence)
    return Sensitivity(tuple(inputs), tuple(done[name] for name in outputs))


@dataclass(frozen=True)
class _Measures:
    """The measures of responses that share their rows; positions of names in the arrays."""

    variables: dict[str, int]
    responses: dict[str, int]
    mean: Array
    std: Array
    linear: Linear
    rank: Rank
    effects: Effects
    independent: bool


def _measure(columns: dict[str, Array], values: dict[str, Array], confidence: float) -> _Measures | None:
    """Return all measures, or None where there are too few rows or nothing varies."""
    x_names = [name for name, column in columns.items() if _varies(column)]
    y_names = [name for name, column in values.items() if _varies(column)]
    if not x_names or not y_names:
        return None
    n = next(iter(values.values())).size
    if n < fewest_rows(len(x_names)):
        return None
    rows = random_rows(n)
    x = np.column_stack([columns[name][rows] for name in x_names])
    y = np.column_stack([values[name][rows] for name in y_names])
    sums = group_sums(x, y, most_degree(rows.size, len(x_names)))
    regression = linear(sums)
    off_diagonal = np.abs(regression.correlation - np.eye(len(x_names))).max()
    independent = bool(off_diagonal <= 0.02 + 4 / np.sqrt(rows.size))
    ends = np.quantile(x, [0.05, 0.95], axis=0)
    return _Measures(
        variables={name: i for i, name in enumerate(x_names)},
        responses={name: i for i, name in enumerate(y_names)},
        mean=y.mean(axis=0),
        std=y.std(axis=0),
        linear=regression,
        rank=rank(x, y, confidence),
        effects=effects(sums, (ends[0], ends[1]), independent=independent),
        independent=independent,
    )


def fewest_rows(variables: int) -> int:
    """Return how many rows a regression on that many variables needs here: two a group, five a variable."""
    return max(2 * GROUPS, 5 * (variables + 1))


def _response(
    name: str,
    columns: dict[str, Array],
    y: Array,
    sample: NDArray[np.int64],
    limits: tuple[float | None, float | None],
    found: _Measures | None,
    designed: TotalOrder | str | None,
    confidence: float,
) -> ResponseSensitivity:
    """Gather what is known of one response."""
    worst = worst_samples(sample, y, columns, *limits)
    varying = {v: column for v, column in columns.items() if _varies(column)}
    constant = [v for v in columns if v not in varying]
    notes = [f"{v} does not vary: nothing can depend on it." for v in constant if y.size]
    if found is None or name not in found.responses:
        return ResponseSensitivity(
            name, y.size, None, None, None, None, None, None, tuple(map(Influence, columns)), OPEN, None, worst,
            (*notes, _why_nothing(y, len(varying))),
        )  # fmt: skip
    at, quantile = found.responses[name], jackknife_quantile(GROUPS, confidence)
    shares = found.effects
    unexplained = float(shares.unexplained[at])
    interaction_interval = _share_interval(unexplained, quantile * float(shares.unexplained_error[at]))
    totals = designed if isinstance(designed, TotalOrder) else None
    influences = tuple(_influence(v, at, found, confidence) for v in columns)
    if totals is not None:
        influences = tuple(_with_total(i, totals, confidence) for i in influences)
    return ResponseSensitivity(
        response=name,
        n=y.size,
        independent=found.independent,
        degree=int(shares.degree[at]),
        r2=float(found.linear.r2[at]),
        r2_rank=float(found.rank.r2[at]),
        interaction=_share(unexplained),
        interaction_interval=interaction_interval,
        influences=influences,
        verdict=_verdict(influences, interaction_interval[1] if totals is None else 0.0),
        rejects=reject_causes(y, varying, *limits, confidence),
        worst=worst,
        notes=(*notes, *_notes(found, unexplained, designed), *_interacting(influences, totals, confidence)),
    )


def _influence(variable: str, at: int, found: _Measures, confidence: float) -> Influence:
    """Gather what is known of one variable's influence on the response at a position."""
    if variable not in found.variables:
        return Influence(variable, verdict=NOT_CRITICAL)
    i, quantile = found.variables[variable], jackknife_quantile(GROUPS, confidence)
    line, ranks, alone, std = found.linear, found.rank, found.effects, float(found.std[at])
    coefficient, error = float(line.coefficient[at, i]), float(line.coefficient_error[at, i])
    share, share_error = float(alone.share[at, i]), float(alone.share_error[at, i])
    contribution = None if line.contribution is None else float(line.contribution[at, i])
    contribution_error = 0.0 if line.contribution_error is None else float(line.contribution_error[at, i])
    curve = found.mean[at] + std * alone.curve[at, i]
    swing, swing_half = float(np.ptp(curve)), quantile * std * float(alone.swing_error[at, i])
    needed = _needed(len(found.variables), confidence)
    linear_effect = abs(coefficient) > needed * error and coefficient**2 > NEGLIGIBLE_SHARE
    significant = linear_effect or share > max(needed * share_error, NEGLIGIBLE_SHARE)
    interval = _share_interval(share, quantile * share_error)
    return Influence(
        variable=variable,
        coefficient=coefficient,
        coefficient_interval=(coefficient - quantile * error, coefficient + quantile * error),
        contribution=contribution,
        contribution_interval=(
            None if contribution is None else _share_interval(contribution, quantile * contribution_error)
        ),
        inflation=float(line.inflation[i]) if np.isfinite(line.inflation[i]) else None,
        spearman=float(ranks.spearman[at, i]),
        spearman_interval=(float(ranks.spearman_low[at, i]), float(ranks.spearman_high[at, i])),
        rank_coefficient=float(ranks.coefficient[at, i]),
        first_order=_share(share),
        first_order_interval=interval,
        low=float(curve.min()),
        high=float(curve.max()),
        swing_interval=(max(swing - swing_half, 0.0), swing + swing_half),
        curve=tuple(zip(alone.curve_x[i].tolist(), curve.tolist(), strict=True)),
        significant=bool(significant),
        verdict=_word(share, interval, significant=bool(significant)),
    )


def _with_total(influence: Influence, totals: TotalOrder, confidence: float) -> Influence:
    """Return a variable's influence with its total index, which then decides."""
    if influence.first_order is None or influence.variable not in totals.variables:
        return influence
    i, quantile = totals.variables.index(influence.variable), jackknife_quantile(GROUPS, confidence)
    total, error = float(totals.total[i]), float(totals.total_error[i])
    interactions, half = float(totals.interactions[i]), quantile * float(totals.interactions_error[i])
    needed = _needed(len(totals.variables), confidence)
    significant = bool(influence.significant) or total > max(needed * error, NEGLIGIBLE_SHARE)
    interval = _share_interval(total, quantile * error)
    return replace(
        influence,
        total=_share(total),
        total_interval=interval,
        interactions=_share(interactions),
        interactions_interval=_share_interval(interactions, half),
        significant=significant,
        verdict=_word(total, interval, significant=significant),
    )


def _needed(variables: int, confidence: float) -> float:
    """Return by how many standard errors an effect must differ from 0 (Bonferroni over the variables)."""
    # Two tests a variable, each of two sides: either may find it.
    return jackknife_quantile(GROUPS, 1 - (1 - confidence) / (2 * variables))


def _word(share: float, interval: Interval, *, significant: bool) -> str:
    """Return the verdict on a variable that explains a share."""
    if significant and share >= CRITICAL_SHARE:
        return CRITICAL
    return OPEN if interval[1] >= CRITICAL_SHARE else NOT_CRITICAL


def _verdict(influences: tuple[Influence, ...], interaction: float) -> str:
    """Return the verdict of a response; its interactions at most so large."""
    verdicts = {influence.verdict for influence in influences}
    if CRITICAL in verdicts:
        return CRITICAL
    return OPEN if OPEN in verdicts or interaction >= CRITICAL_SHARE else NOT_CRITICAL


def _notes(found: _Measures, unexplained: float, designed: TotalOrder | str | None) -> tuple[str, ...]:
    """Return what to mind in reading the numbers of a response."""
    determined = [v for v, i in found.variables.items() if not np.isfinite(found.linear.inflation[i])]
    notes = (
        (not found.independent, "The variables are correlated: first-order indices overlap and need not add up to 1."),
        (
            bool(determined),
            f"{', '.join(determined)}: determined by the other variables, so coefficients are not unique.",
        ),
        (
            unexplained >= CRITICAL_SHARE,
            f"{100 * unexplained:.0f} % of the variance is no sum of effects of single variables: "
            + (
                "the shares with interactions say whose."
                if isinstance(designed, TotalOrder)
                else "a variable without effect alone may still matter together with others; a designed sample (sampler"
                " saltelli) gives total indices."
            ),
        ),
        (isinstance(designed, str), str(designed)),
    )
    return tuple(text for holds, text in notes if holds)


def _interacting(influences: tuple[Influence, ...], totals: TotalOrder | None, confidence: float) -> tuple[str, ...]:
    """Return which variables act through interactions: a tenth of the variance at least, and no chance."""
    if totals is None:
        return ()
    needed = _needed(len(totals.variables), confidence)
    sure = dict(zip(totals.variables, totals.interactions > needed * totals.interactions_error, strict=True))
    told = [
        f"{i.variable} explains {100 * i.total:.0f} % with them and {100 * (i.first_order or 0.0):.0f} % alone"
        for i in influences
        if i.total is not None and (i.interactions or 0.0) >= CRITICAL_SHARE and sure[i.variable]
    ]
    return (f"Acting through interactions: {', '.join(told)}.",) if told else ()


def _why_nothing(y: Array, variables: int) -> str:
    """Return why a response has no sensitivity."""
    needed = fewest_rows(max(variables, 1))
    if y.size < needed:
        return f"{y.size} samples: a sensitivity to {variables} variables needs at least {needed}."
    if not _varies(y):
        return "All values are equal: nothing moves this response."
    return "No variable varies: nothing to depend on."


def _varies(column: Array) -> bool:
    """Return whether a column is more than a constant and its rounding."""
    if column.size < 2:
        return False
    return float(np.std(column)) > _ROUNDING * float(np.abs(column).max())


def _share(value: float) -> float:
    """Return an estimate of a share as a share."""
    return min(max(value, 0.0), 1.0)


def _share_interval(value: float, half: float) -> Interval:
    """Return the interval of a share, within what a share can be."""
    return _share(value - half), _share(value + half)


def _same_rows(rows: dict[str, NDArray[np.bool_]]) -> list[list[str]]:
    """Return the names grouped by equal rows."""
    groups: dict[bytes, list[str]] = {}
    for name, at in rows.items():
        groups.setdefault(np.packbits(at).tobytes(), []).append(name)
    return list(groups.values())


def _length(columns: dict[str, Array]) -> int:
    """Return the common length of the columns."""
    if not columns:
        return 0
    shape = next(iter(columns.values())).shape
    wrong = [name for name, column in columns.items() if column.shape != shape or column.ndim != 1]
    if wrong:
        raise ReportError(f"sensitivity: {', '.join(wrong)}: not as long as the others; give columns of one table")
    return int(shape[0])
