"""Stack-up of a response: the worst case over the corners of the tolerance box, and from the slopes of the samples.

The worst case over the corners is that of the paper (appendix A, eqs. 24-27): it needs a campaign of corners. Worst
case and root sum of squares from slopes use the samples of one Monte Carlo campaign. This is the stack-up sheet of a
drawing office: ``y = y0 + sum s_i (x_i - m_i)``, with m_i the middle of the tolerance of variable i and t_i half its
width. All parts at their worst end give ``sum |s_i| t_i``; independent parts give ``sqrt(sum (s_i t_i)^2)``. The slopes
s_i are those of the least-squares plane through the samples. The result is exact for a response that is a weighted sum;
the share of the variance that the plane explains shows the departure from this.

The tolerance of a variable extends from its lower to its upper bound. Without a bound it ends at three standard
deviations from the mean.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from reporting.arrays import ROUNDING, Array, Columns, some_of
from reporting.errors import ReportError
from reporting.samples import SMALLEST
from reporting.shape.sorted_sample import SortedSample, sorted_sample
from reporting.spec import VariableSpec

# The worst case of a plane that explains a smaller share of the variance is not reliable.
LINEAR_SHARE = 0.97
# Squares and products that explain this much more of the variance, beyond chance, indicate a curved response.
CURVED_SHARE, _CHANCE = 0.01, 1e-3
LINEAR, CURVED, OTHER, CONSTANT = "linear", "curved", "not linear", "constant"
_ROWS = 20_000
_ROWS_PER_TERM, _LEAST_ROWS = 3, 20
_ROWS_PER_SQUARE, _MOST_TERMS = 10, 150
BENDER = 1.5
_REACH = 3.0  # standard deviations at which a tolerance without a bound ends
_CENTRAL = (0.135, 99.865)  # percentiles that contain as much as mean +- 3 sigma of a normal distribution

Command = Callable[[Mapping[str, float]], str]


@dataclass(frozen=True)
class WorstCase:
    """The extremes of a response over the corners of the tolerance box; None if no corner has a value."""

    lowest: float | None  # LSL_Y of the paper (eq. 24)
    highest: float | None  # USL_Y (eq. 25)
    nominal: float | None  # mean of the two, N_Y (eq. 26)
    tolerance: float | None  # half their difference, T_Y (eq. 27)
    lowest_corner: dict[str, float]  # inputs at the extreme: each variable at an end of its range
    highest_corner: dict[str, float]
    corners: int  # simulated
    missing: int  # corners without a value
    within: bool | None  # every corner has a value and keeps the limits; None without limits


def worst_case(y: Array, inputs: dict[str, Array], lsl: float | None = None, usl: float | None = None) -> WorstCase:
    """Return the worst case of one response, NaN where it has no value; columns have the shape (n,)."""
    # The extremes lie at corners only if the response is monotone in every input. Other samples, such as the centre,
    # are included; a response that is not monotone may still have larger extremes inside the box. ReportError: the
    # columns differ in length.
    y = np.asarray(y, np.float64)
    wrong = [name for name, column in inputs.items() if np.shape(column) != y.shape]
    if wrong:
        raise ReportError(
            f"worst case: {', '.join(wrong)}: differs in length from the response; give columns of one table"
        )
    rows = np.flatnonzero(np.isfinite(y))
    missing = y.size - rows.size
    limited = lsl is not None or usl is not None
    if rows.size == 0:
        return WorstCase(None, None, None, None, {}, {}, y.size, missing, False if limited else None)
    low, high = (int(rows[choose(y[rows])]) for choose in (np.argmin, np.argmax))
    lowest, highest = float(y[low]), float(y[high])
    within = (lsl is None or lowest >= lsl) and (usl is None or highest <= usl) and missing == 0
    corner = {at: {name: float(column[at]) for name, column in inputs.items()} for at in (low, high)}
    return WorstCase(
        lowest=lowest,
        highest=highest,
        nominal=0.5 * (lowest + highest),
        tolerance=0.5 * (highest - lowest),
        lowest_corner=corner[low],
        highest_corner=corner[high],
        corners=y.size,
        missing=missing,
        within=within if limited else None,
    )


@dataclass(frozen=True)
class StackedVariable:
    """Contribution of one variable to the stack-up of a response."""

    variable: str
    lower: float  # end of its tolerance, in its unit
    upper: float
    # both ends are bounds of its distribution; else at least one is three standard deviations from the mean
    bounded: bool
    slope: float  # change of the response per unit of the variable
    half_width: float  # ``|slope| (upper - lower) / 2``: contribution to the worst case, in the response's unit


@dataclass(frozen=True)
class LinearStack:
    """Worst case and root sum of squares from slopes, compared with the range of the samples."""

    variables: tuple[StackedVariable, ...]  # by their contribution, the largest first
    nominal: float  # value of the plane with every variable in the middle of its tolerance
    worst: tuple[float, float]  # every variable at its worst end: nominal -+ the sum of the half widths
    rss: tuple[float, float]  # nominal -+ the root of the sum of squares of the half widths
    rss_sigma: float  # root of the sum of squares of slope times the variable's own sigma
    bender: tuple[float, float]  # nominal -+ 1.5 times the root sum of squares, for shifts that are not known (Bender)
    shift: float  # of the response, from the means of the variables that are not in the middle of their tolerances
    inertia: float  # root of rss_sigma^2 + shift^2: inertial tolerancing (ISO 18391, NF XP E04-008)
    # Whether `rss` and `rss_sigma` use the correlations of the samples, because the campaign requests correlations. The
    # worst case does not: every combination of ends is considered possible.
    correlated: bool
    sampled: tuple[float, float]  # smallest and largest value of the samples
    # Percentiles 0.135 and 99.865 of the samples, which contain as much as mean +- 3 sigma of a normal distribution;
    # with few samples they are the smallest and the largest value.
    central: tuple[float, float]
    n: int  # samples with a value
    explained: float | None  # share of the variance that the plane explains, adjusted; None without variance
    explained_curved: float | None  # with squares and products, or squares alone; None if samples are too few
    # "linear": the plane explains at least 97 % of the variance, and squares add less than 1 %. "curved": squares and
    # products add 1 % or more, beyond chance. "not linear": the plane explains less than 97 %, and no curve is found.
    # "constant": no variance.
    shape: str
    exceeded: bool  # a sample lies beyond the worst case from slopes, which is then not the worst case
    reliable: bool  # the response is linear or constant, and no sample lies beyond the worst case
    lowest_corner: dict[str, float]  # variables where the plane is lowest; this run and that of the highest check it
    highest_corner: dict[str, float]
    lowest_command: str  # the command of this run
    highest_command: str
    within: bool | None  # the worst case from slopes keeps the limits; None without limits, or if not reliable


def linear_stack(
    y: Array,
    columns: Mapping[str, Array],
    specs: Sequence[VariableSpec],
    limits: tuple[float | None, float | None] = (None, None),
    *,
    correlated: bool = False,
    command: Command = lambda _: "",
    ordered: SortedSample | None = None,
) -> LinearStack | None:
    """Return the stack-up of one response; None if no variable varies or the values are too few for the slopes.

    `ordered` are the finite values of the response, if somebody has sorted them.
    """
    # Columns have the shape (n,); the response is NaN where it has no value. `correlated`: the campaign requests
    # correlations. `command` gives the command that simulates values by variable.
    varying = [v for v in specs if v.std > 0]
    inputs = Columns.of(columns).only(v.name for v in varying)
    has = np.isfinite(y) if inputs.finite is None else np.isfinite(y) & inputs.finite
    n = int(np.count_nonzero(has))
    if not varying or n < max(_LEAST_ROWS, _ROWS_PER_TERM * (len(varying) + 1)):
        return None
    rows = some_of(has)[:_ROWS]
    x = np.column_stack([inputs.take(v.name, rows) for v in varying])
    plane = _plane(y[rows], x)
    ends = np.array([tolerance_of(v) for v in varying])
    steps = plane.slopes * np.ptp(ends, axis=1) / 2
    nominal = float(plane.mean + plane.slopes @ (ends.mean(axis=1) - x.mean(axis=0)))
    together = _correlations(x) if correlated else np.eye(len(varying))
    half, sigma = _root(steps, together), _root(plane.slopes * np.array([v.std for v in varying]), together)
    shift = float(plane.slopes @ (np.array([v.mean for v in varying]) - ends.mean(axis=1)))
    worst = _around(nominal, float(np.abs(steps).sum()))
    known = ordered if ordered is not None and n == ordered.values.size else sorted_sample(y[has])
    sampled = float(known.values[0]), float(known.values[-1])
    low, high = known.quantiles(np.divide(_CENTRAL, 100))
    exceeded = min(sampled[0] - worst[0], worst[1] - sampled[1]) < -ROUNDING * max(map(abs, sampled))
    reliable = plane.shape in (LINEAR, CONSTANT) and not exceeded
    corners = [_corner(specs, varying, ends, sign * plane.slopes) for sign in (-1, 1)]
    stacked = [
        StackedVariable(v.name, float(low), float(high), None not in (v.lower, v.upper), float(slope), abs(float(step)))
        for v, (low, high), slope, step in zip(varying, ends, plane.slopes, steps, strict=True)
    ]
    return LinearStack(
        variables=tuple(sorted(stacked, key=lambda each: -each.half_width)),
        nominal=nominal,
        worst=worst,
        rss=_around(nominal, half),
        rss_sigma=sigma,
        bender=_around(nominal, BENDER * half),
        shift=shift,
        inertia=math.hypot(sigma, shift),
        correlated=correlated,
        sampled=sampled,
        central=(float(low), float(high)),
        n=n,
        explained=plane.explained,
        explained_curved=plane.explained_curved,
        shape=plane.shape,
        exceeded=exceeded,
        reliable=reliable,
        lowest_corner=corners[0],
        highest_corner=corners[1],
        lowest_command=command(corners[0]),
        highest_command=command(corners[1]),
        within=_is_within(worst, limits) if reliable else None,
    )


def tolerance_of(spec: VariableSpec) -> tuple[float, float]:
    """Return the ends of a variable's tolerance: its bounds, or three standard deviations without bounds."""
    low, high = (float(f"{spec.mean + sign * _REACH * spec.std:.12g}") for sign in (-1, 1))  # as written by hand
    return low if spec.lower is None else spec.lower, high if spec.upper is None else spec.upper


@dataclass(frozen=True)
class _Plane:
    """The least-squares plane through samples, with slopes of shape (k,), and its explained share of the variance."""

    mean: float
    slopes: Array
    explained: float | None
    explained_curved: float | None
    shape: str


def _plane(y: Array, x: Array) -> _Plane:
    """Return the plane through the samples; variables that do not vary have the slope 0."""
    n, k = x.shape
    # the deviation of a column that is nearly constant may underflow
    spread = np.where(x.std(axis=0) > SMALLEST, x.std(axis=0), np.inf)
    z, deviation = (x - x.mean(axis=0)) / spread, y - y.mean()
    if not deviation.std() > ROUNDING * np.abs(y).max():
        return _Plane(float(y.mean()), np.zeros(k), None, None, CONSTANT)
    slopes = np.linalg.lstsq(z, deviation, rcond=None)[0]
    most_terms = min(_MOST_TERMS, n // _ROWS_PER_SQUARE)
    # Products of all pairs take ten rows for each term, and no more than 150 terms; else squares alone.
    i, j = np.triu_indices(k) if (k + 1) * (k + 2) // 2 <= most_terms else (np.arange(k), np.arange(k))
    straight, curved, is_curved = _residual_squares(np.column_stack([np.ones(n), z]), deviation), None, False
    if 1 + k + i.size <= most_terms:
        squares = _residual_squares(np.column_stack([np.ones(n), z, z[:, i] * z[:, j]]), deviation)
        gain = (straight[0] - squares[0]) / i.size / max(squares[0] / squares[1], np.finfo(np.float64).tiny)
        curved = _share(squares, deviation)
        is_curved = curved - _share(straight, deviation) >= CURVED_SHARE and fdtrc(i.size, squares[1], gain) < _CHANCE
    explained = _share(straight, deviation)
    shape = CURVED if is_curved else LINEAR if explained >= LINEAR_SHARE else OTHER
    return _Plane(float(y.mean()), slopes / spread, explained, curved, shape)


def _residual_squares(terms: Array, deviation: Array) -> tuple[float, int]:
    """Return the residual sum of squares of a fit of the terms, and its degrees of freedom."""
    residual = deviation - terms @ np.linalg.lstsq(terms, deviation, rcond=None)[0]
    return float(residual @ residual), terms.shape[0] - terms.shape[1]


def _share(squares: tuple[float, int], deviation: Array) -> float:
    """Return the explained share of the variance, adjusted for the number of terms; at least 0."""
    return max(1.0 - squares[0] / squares[1] / float(deviation @ deviation) * (deviation.size - 1), 0.0)


def _correlations(x: Array) -> Array:
    """Return the correlation matrix of columns; a column that does not vary is uncorrelated with all others."""
    with np.errstate(all="ignore"):
        found = np.nan_to_num(np.corrcoef(x, rowvar=False).reshape(x.shape[1], -1))
    np.fill_diagonal(found, 1.0)
    return found


def _root(steps: Array, together: Array) -> float:
    """Return the root of the sum of squares of steps, including their correlations."""
    return math.sqrt(max(float(steps @ together @ steps), 0.0))


def _around(middle: float, half_width: float) -> tuple[float, float]:
    """Return both ends of a range around its middle."""
    return middle - half_width, middle + half_width


def _corner(
    specs: Sequence[VariableSpec], varying: Sequence[VariableSpec], ends: Array, slopes: Array
) -> dict[str, float]:
    """Return the values at which a plane with these slopes is highest; a constant keeps its value."""
    highest = {v.name: float(ends[i, int(slopes[i] > 0)]) for i, v in enumerate(varying)}
    return {v.name: highest.get(v.name, v.mean) for v in specs}


def _is_within(ends: tuple[float, float], limits: tuple[float | None, float | None]) -> bool | None:
    """Return whether a range keeps the limits; None without limits."""
    lsl, usl = limits
    return None if limits == (None, None) else (lsl is None or ends[0] >= lsl) and (usl is None or ends[1] <= usl)
