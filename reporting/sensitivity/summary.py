"""The sensitivity of responses to variables, by every measure, from the given samples.

Linear and rank regression (`regression`), first-order Sobol' indices and conditional expectations (`first_order`),
total-order indices if the samples are a design (`total_order`), common properties of rejects, and the worst samples
(`reject_attribution`).

Some of the variance no sum of functions of single variables explains. Repeats with half the step measure how much of it
is scatter, which no input causes; only the rest can be interactions or jumps. `docs/sensitivity.md` has the derivation
and its test.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting import format_numbers
from reporting.arrays import Array, Columns, varies
from reporting.capability.intervals import Interval
from reporting.capability.lots import LEAST_LOTS
from reporting.errors import ReportError
from reporting.sensitivity.first_order import jackknife_quantile
from reporting.sensitivity.influence import (
    CORRELATED,
    CRITICAL_SHARE,
    FEWEST_CARRIERS,
    OPEN,
    RANKS,
    Influence,
    Measures,
    ResponseSensitivity,
    Sensitivity,
    as_share,
    fewest_rows,
    influence_of,
    measure,
    needed_errors,
    response_verdict,
    with_shapley,
    with_total_effect,
    with_total_order,
)
from reporting.sensitivity.regression import MOST_SHARED
from reporting.sensitivity.reject_attribution import reject_attribution, reject_causes, worst_samples
from reporting.sensitivity.repeatability import Repeatability
from reporting.sensitivity.shapley_effects import JointEffects
from reporting.sensitivity.total_order import TotalOrder

# In `studies.coverage` the interval of a share carried by fewer misses more than one in twenty, all of them too low.
_FEWEST_OF_INTERACTIONS = 100


@dataclass(frozen=True)
class Known:
    """Information about a response beyond one run of each sample."""

    totals: TotalOrder | str | None = None  # total-order indices of a design, or why there are none
    repeatability: Repeatability | None = None  # from repeats with half the step

    @property
    def scatter(self) -> tuple[float, Interval] | None:
        """Share of the variance that is scatter, and its interval; None if it is not measured."""
        found = self.repeatability
        if found is None or found.share is None or found.share_interval is None:
            return None
        return found.share, found.share_interval


@dataclass(frozen=True)
class Unexplained:
    """A share of the variance that no sum of functions of single variables explains."""

    share: float  # the whole; the estimate may lie outside 0 to 1 by chance
    interval: Interval
    scatter: float | None = None  # the part that no input causes; None if it is not measured
    scatter_interval: Interval | None = None
    rest: float | None = None  # the share without scatter: interactions and jumps; None if scatter is not measured
    rest_interval: Interval | None = None

    @property
    def most_interactions(self) -> float:
        """The largest possible share of interactions."""
        return self.interval[1] if self.rest_interval is None else self.rest_interval[1]


def split(share: float, half: float, known: Known) -> Unexplained:
    """Return an unexplained share, whose interval has the half width `half`, split into its parts."""
    # The squared distance to each end of the rest's interval is the sum of the squared distances of both shares (method
    # of variance estimates recovery: their errors are independent, because repeats are separate runs).
    # A few samples far out carry much of it, so that estimates far below the true share are more frequent than ones far
    # above: upwards the interval is that of the share's logarithm, up to twice the share.
    relative = min(half / share, 2.0) if share > 0 else 2.0
    above = half * math.expm1(relative) / relative if relative > 0 else 0.0
    interval = as_share(share - half), as_share(share + above)
    if known.scatter is None:
        return Unexplained(share, interval)
    scatter, (low, high) = known.scatter
    rest = share - scatter
    ends = as_share(rest - math.hypot(half, high - scatter)), as_share(rest + math.hypot(above, scatter - low))
    return Unexplained(share, interval, scatter, (low, high), as_share(rest), ends)


def without_scatter(totals: TotalOrder, known: Known, quantile: float) -> TotalOrder:
    """Return total-order indices without the scatter that each of them contains."""
    # A total-order index is half the mean squared difference of two runs that differ in one variable, divided by the
    # variance. Each run scatters independently, so scatter adds its whole share of the variance to the total-order
    # index of every variable and to its interactions, but nothing to the first-order index. If the two runs are equal,
    # the variable has no effect and no scatter is subtracted.
    if known.scatter is None:
        return totals
    share, (low, high) = known.scatter
    error = (high - low) / (2 * quantile)
    off = np.minimum(share, np.maximum(totals.total, 0.0))
    return replace(
        totals,
        total=totals.total - off,
        total_error=np.hypot(totals.total_error, np.where(off > 0, error, 0.0)),
        interactions=totals.interactions - off,
        interactions_error=np.hypot(totals.interactions_error, np.where(off > 0, error, 0.0)),
    )


def note_on(found: Unexplained, known: Known, *, independent: bool) -> str:
    """Return what an unexplained share of at least a tenth means, and how to learn more; empty for smaller shares."""
    if found.share < CRITICAL_SHARE:
        return ""
    text = f"{_percent(found.share)} of the variance does not come from variables acting alone"
    if found.rest is None or found.scatter is None or found.scatter_interval is None:
        return f"{text}: interactions, jumps, or scatter that no repeat has measured. {_advice(known, independent)}"
    low, high = map(_percent, found.scatter_interval)
    text += f"; {_percent(found.scatter)} ({low} to {high}) is scatter that no input causes (repeatability)"
    if found.rest < CRITICAL_SHARE:
        return f"{text}, which explains it: no further samples will find a variable that causes it."
    if found.rest_interval is not None and found.rest_interval[0] <= 0.0:
        return f"{text}, which may explain all of it: samples and repeats do not show whether variables interact."
    return f"{text}. The rest, {_percent(found.rest)}, is interactions or jumps. {_advice(known, independent)}"


def _advice(known: Known, independent: bool) -> str:
    """Return how to find out which variables interact."""
    if isinstance(known.totals, TotalOrder):
        return "The shares with interactions show which variables cause it."
    if not independent:
        return "Which variables cause it cannot be found out: total-order indices need independent variables."
    first = "First repeat some samples (clearcap repeat). " if known.scatter is None else ""
    return (
        f"{first}A variable with no effect of its own may still matter in combination with others: a campaign with the"
        " sampler saltelli shows it (total-order indices)."
    )


def _percent(share: float) -> str:
    """Return a share as percent without decimals."""
    return f"{100 * as_share(share):.0f} %"


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
    inputs, outputs = Columns.of(variables), Columns.of(responses)
    n = _length(inputs, outputs)
    sample = np.arange(n) if sample is None else sample
    complete = np.ones(n, np.bool_) if inputs.finite is None else inputs.finite
    finite = {name: outputs.only([name]).finite for name in outputs}
    rows = {name: complete if known is None else complete & known for name, known in finite.items()}
    done: dict[str, ResponseSensitivity] = {}
    # Responses with values in the same rows share one pass over them.
    for names in _same_rows(rows):
        at = rows[names[0]]
        columns, values = inputs.where(at), outputs.where(at).only(names)
        of_rows = None if lots is None else lots[at]
        count = None if of_rows is None else np.unique(of_rows).size
        measures = measure(columns.varying, values, confidence, correlations, of_rows)
        for name in names:
            lsl, usl = (limits or {}).get(name, (None, None))
            more, y = (known or {}).get(name, Known()), values[name]
            found = _response(
                name, columns, y, sample if at.all() else sample[at], (lsl, usl), measures, more, confidence
            )
            out = (y < (-np.inf if lsl is None else lsl)) | (y > (np.inf if usl is None else usl))
            costs = reject_attribution(columns, out, confidence, of_rows) if np.any(out) else None
            done[name] = replace(found, attribution=costs, notes=(*found.notes, *_of_lots(count, int(at.sum()))))
    return Sensitivity(tuple(inputs), tuple(done[name] for name in outputs))


def _response(
    name: str,
    columns: Columns,
    y: Array,
    sample: NDArray[np.int64],
    limits: tuple[float | None, float | None],
    measures: Measures | None,
    known: Known,
    confidence: float,
) -> ResponseSensitivity:
    """Return the sensitivity of one response."""
    worst = worst_samples(sample, y, columns, *limits)
    varying = columns.varying
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
    carriers = float(shares.residual_carriers[at])
    error = max(error, abs(unexplained) / math.sqrt(carriers))  # the jackknife's own error is large if these are few
    left_over = split(unexplained, quantile * error, known)
    totals = without_scatter(known.totals, known, quantile) if isinstance(known.totals, TotalOrder) else None
    scatter = left_over.scatter or 0.0
    influences = tuple(influence_of(v, at, measures, left_over.most_interactions, confidence) for v in columns)
    influences = tuple(with_total_effect(i, at, measures, scatter, confidence) for i in influences)
    influences = tuple(with_shapley(i, at, measures, scatter, confidence) for i in influences)
    if totals is not None:
        influences = tuple(with_total_order(i, totals, confidence) for i in influences)
    uncovered = left_over.most_interactions
    joint: JointEffects | None = shapley or together  # one of them at most
    if joint is not None:
        row = at if shapley else 0
        half = quantile * float(joint.remainder_error[row])
        uncovered = split(float(joint.remainder[row]), half, known).most_interactions
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
            *_of_few(left_over, carriers),
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


def _of_few(found: Unexplained, carriers: float) -> tuple[str, ...]:
    """Return that a share of interactions of a percent or more rests on few samples, or lots."""
    if carriers >= _FEWEST_OF_INTERACTIONS or found.most_interactions < CRITICAL_SHARE / 10:
        return ()
    return (
        f"Few samples or lots (about {max(round(carriers), 1)}) determine the share of interactions: rarer ones may"
        " raise it.",
    )


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


def _length(*tables: Columns) -> int:
    """Return the common length of the columns; raise ReportError if they differ."""
    sizes = set[int]().union(*(table.sizes for table in tables))
    if len(sizes) > 1:
        given = [(name, column.size) for table in tables for name, column in table.items()]
        wrong = [name for name, size in given if size != given[0][1]]
        raise ReportError(
            f"sensitivity: {', '.join(wrong)}: differs in length from the others; give columns of one table"
        )
    return sizes.pop() if sizes else 0
