"""Values in order: whether they look like those of a stable process, control charts, and how an index converges.

Capability and its intervals take the order for accidental. Measured parts have one: tools wear, shifts and batches of
material differ, and neighbours resemble each other. Three tests of the ranks, so of any distribution, ask whether the
order is accidental; each sees what the others overlook:

- neighbours: serial correlation of each value with the next (Wald and Wolfowitz 1943, on ranks);
- trend: rank correlation with the place (Spearman);
- groups: differences between groups of consecutive values, as many groups as values in each (Kruskal and Wallis 1952).

Mean and variance of the first two are exact for any ties. Neighbours may resemble each other too much, or differ too
much: parts come from two spindles in turn, or a machine is readjusted after each part.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc, chdtrc, ndtr, ndtri, stdtr

from reporting.arrays import MOST_ROWS, ROUNDING, Array, centred_ranks, magnitude, standard_deviation, varies
from reporting.capability.indices import cpk, cpk_influence
from reporting.capability.interval_choice import (
    NORMAL,
    Fence,
    OwnMoments,
    Values,
    choose_method,
    precision_by,
    precision_of_moments,
    robust_intervals,
    running_moments,
)
from reporting.capability.intervals import cpk_half_width, mean_interval
from reporting.capability.lots import describe_lots, independent, mean_error
from reporting.capability.within import LARGEST_FOR_RANGES, c4, d2, d3, sigma_of_std
from reporting.errors import ReportError
from reporting.spec import ChartPlan

# At most this share of stable processes raises an alarm. Measured: see studies/row_order.md.
FALSE_ALARMS = 0.01
# Fewer values, or lots, show only what is plain to see; of fewer different ones the tests raise too many alarms.
FEWEST, FEWEST_DIFFERENT = 20, 5
_TESTS = 3
# How surely a correlation of neighbours must be found to count as seen, and by which part the interval of the mean must
# be too narrow to be worth a sentence.
_SEEN, _NARROWER = 0.95, 0.2
_MOST_CORRELATED = 0.9
DIFFER = "differ more than chance would have it"


@dataclass(frozen=True)
class RowOrder:
    """What the order of the values says of the process that made them."""

    n: int  # values, or lots
    neighbours: float  # rank correlation of each value with the next one
    trend: float  # rank correlation of the values with their place
    between: float  # share of the variance of the ranks that lies between groups of consecutive values
    # Of the most conspicuous of the three, corrected for their number: in at most this share of stable processes the
    # order is as conspicuous by chance.
    p: float
    seen: str  # what is conspicuous; empty if p is not below `FALSE_ALARMS`
    finding: str  # what is wrong and what to do, in sentences; empty like `seen`

    @property
    def unseen(self) -> str:
        """What so few values do not show, in one sentence; empty if that is little."""
        # The rank correlation of independent neighbours has the variance 1 / n; a correlation rho of neighbours (a
        # first-order autoregression) multiplies the variance of a mean by (1 + rho) / (1 - rho).
        scores = float(ndtri(1 - FALSE_ALARMS / (2 * _TESTS)) + ndtri(_SEEN))
        rho = min(scores / math.sqrt(self.n), _MOST_CORRELATED)
        growth = math.sqrt((1 + rho) / (1 - rho))
        if growth < 1 + _NARROWER:
            return ""
        return (
            f"{self.n} values show a correlation of neighbours surely only above {rho:.2f}; below, the interval of the"
            f" mean may be up to {growth:.1f} times too narrow."
        )


def row_order(x: Array, lots: NDArray[np.generic] | None = None) -> RowOrder | None:
    """Return what the order of values, or of means of lots, says; None below `FEWEST` or `FEWEST_DIFFERENT`."""
    values = x
    if lots is not None:
        _, first, group = np.unique(lots, return_index=True, return_inverse=True)
        values = (np.bincount(group, weights=x) / np.bincount(group))[np.argsort(first)]
    n = values.size
    if n < FEWEST or not any(np.unique(part).size >= FEWEST_DIFFERENT for part in (values[:1000], values)):
        return None
    centred = centred_ranks(values)
    squares = float(np.sum(centred**2))
    products = float(centred[:-1] @ centred[1:])
    mean, variance = neighbours_in_random_order(centred)
    neighbours, p_neighbours = products / squares, 2 * float(ndtr(-abs(products - mean) / math.sqrt(variance)))
    place = np.arange(n) - (n - 1) / 2
    trend = float(centred @ place) / math.sqrt(squares * float(place @ place))
    # Over all orders a rank correlation has the variance 1 / (n - 1).
    p_trend = 2 * float(ndtr(-abs(trend) * math.sqrt(n - 1)))
    groups = np.array_split(centred, round(math.sqrt(n)))
    between = sum(group.sum() ** 2 / group.size for group in groups) / squares
    p_groups = float(chdtrc(len(groups) - 1, (n - 1) * between))
    # Bonferroni: the three tests look at the same ranks, so their p-values are dependent.
    p = min(_TESTS * min(p_neighbours, p_trend, p_groups), 1.0)
    seen = finding = ""
    if p < FALSE_ALARMS:
        seen = _seen((p_neighbours, neighbours), (p_trend, trend), (p_groups, between))
        finding = _finding("values" if lots is None else "lots", p, seen)
    return RowOrder(n, neighbours, trend, float(between), p, seen, finding)


def neighbours_in_random_order(centred: Array) -> tuple[float, float]:
    """Return mean and variance of the sum of products of neighbours, over all orders of at least 4 values of mean 0."""
    n, squares, fourth = centred.size, float(np.sum(centred**2)), float(np.sum(centred**4))
    of_two = (squares**2 - fourth) / (n * (n - 1))
    of_three = (2 * fourth - squares**2) / (n * (n - 1) * (n - 2))
    of_four = (3 * squares**2 - 6 * fourth) / (n * (n - 1) * (n - 2) * (n - 3))
    mean = -squares / n
    return mean, (n - 1) * of_two + 2 * (n - 2) * of_three + (n - 2) * (n - 3) * of_four - mean**2


def _seen(neighbours: tuple[float, float], trend: tuple[float, float], groups: tuple[float, float]) -> str:
    """Return what raises the alarm; each test by its p-value and its number."""
    seen = []
    if _TESTS * trend[0] < FALSE_ALARMS:
        seen.append(f"they {'rise' if trend[1] > 0 else 'fall'} from row to row (rank correlation {trend[1]:+.2f})")
    if _TESTS * neighbours[0] < FALSE_ALARMS:
        word = "resemble each other" if neighbours[1] > 0 else DIFFER
        seen.append(f"neighbours {word} (rank correlation {neighbours[1]:+.2f})")
    if not seen:
        seen.append(f"consecutive groups differ ({100 * groups[1]:.0f} % of the variance lies between them)")
    return ", and ".join(seen)


def _finding(what: str, p: float, seen: str) -> str:
    """Return which departure from a random order was found, and what to do."""
    remedy = "; if they were made in lots, give the lot of each" if what == "values" else ""
    chance = "< 0.0001" if p < 1e-4 else f"= {p:.2g}"
    said = f"The {what} are not in random order (p {chance}): {seen}."
    if seen.startswith(f"neighbours {DIFFER}"):
        return (
            f"{said} They may come from two sources in turn (spindles, cavities, fixtures), or the machine is "
            "readjusted after each part: the intervals, which take them for independent, are too wide or too narrow. "
            "Find the cause; analyse the sources apart."
        )
    return (
        f"{said} The process was not stable, so the intervals are too narrow and say little about the parts that it "
        f"will make next. Find the cause{remedy}."
    )


# Control charts: values in order, or means of them, with control limits; their spread; tests of Nelson and of WECO.
#
# `i-mr`: individual values, and moving ranges of two. `xbar-r`, `xbar-s`: means of rational subgroups, and their ranges
# or standard deviations. `ewma`: exponentially weighted moving averages of values or means (Roberts 1959). Without a
# choice subgroups decide: means with ranges up to 8 values in each, with standard deviations above or where sizes
# differ; values without subgroups are individuals up to 60, else means of equal numbers of consecutive ones with their
# pooled sigma. Lots without subgroups are individuals, too: the means of the lots, because lots differ.
#
# Sigma is the mean moving range over d2 (2), the mean range over d2 or the mean standard deviation over c4. The limits
# of means are those of Montgomery (Introduction to Statistical Quality Control, chapters 6 and 9), those of averages
# the exact ones, which widen from the first point on.
#
# A test marks a point where its pattern is complete: Nelson (1984, Journal of Quality Technology 16, 237-239), Western
# Electric (1956, Statistical Quality Control Handbook). They are for independent points: averages and measures of
# spread have only their limits.

MOST_POINTS = 60  # of a chart that nobody asked for
LARGEST_CHART = 1000  # more points cannot be told apart
RANGES_UP_TO = 8  # values in a subgroup; of more, ranges tell less than standard deviations
_FEWEST_POINTS = 5
_ORDERS, _MOST_PERMUTED = 399, 5_000
_ALTERNATING = 199_360_981 / math.factorial(14)  # orders of 14 values that go up and down, beginning with up
Marks = NDArray[np.bool_]


@dataclass(frozen=True)
class Rule:
    """A test of points: `need` of `of` consecutive ones satisfy a condition, among them the last, which is marked."""

    text: str
    conditions: Callable[[Array], tuple[Marks, ...]]  # of scores, shape (..., points); each is counted by itself
    need: int
    of: int
    first: int  # points before the first that can be marked
    chance: float  # that such a point of a stable normal process is marked

    def marked(self, scores: Array) -> Marks:
        """Return which points are marked, from their distances to the centre in sigmas, shape (..., points)."""
        marks = np.zeros(scores.shape, bool)
        for met in self.conditions(scores):
            before = np.concatenate([np.zeros((*met.shape[:-1], self.of), int), np.cumsum(met, axis=-1)], axis=-1)
            count = before[..., self.of :] - before[..., : -self.of]
            marks[..., scores.shape[-1] - met.shape[-1] :] |= met & (count >= self.need)
        return marks


def _zone(text: str, beyond: float, need: int, of: int) -> Rule:
    p = float(ndtr(-beyond))
    chance = 2 * p * (float(bdtrc(need - 2, of - 1, p)) if need > 1 else 1.0)
    return Rule(text, lambda z: (z > beyond, z < -beyond), need, of, need - 1, chance)


def _turns(z: Array) -> tuple[Marks]:
    step = np.sign(np.diff(z, axis=-1))
    return (step[..., 1:] * step[..., :-1] < 0,)


_INSIDE = float(1 - 2 * ndtr(-1))
RULES = {
    "nelson 1": _zone("beyond 3 sigma", 3, 1, 1),
    "nelson 2": _zone("nine in a row on one side", 0, 9, 9),
    "nelson 3": Rule(
        "six in a row that rise or fall", lambda z: (np.diff(z) > 0, np.diff(z) < 0), 5, 5, 5, 2 / math.factorial(6)
    ),
    "nelson 4": Rule("fourteen in a row that alternate", _turns, 12, 12, 13, 2 * _ALTERNATING),
    "nelson 5": _zone("two of three beyond 2 sigma on one side", 2, 2, 3),
    "nelson 6": _zone("four of five beyond 1 sigma on one side", 1, 4, 5),
    "nelson 7": Rule("fifteen in a row within 1 sigma", lambda z: (abs(z) < 1,), 15, 15, 14, _INSIDE**15),
    "nelson 8": Rule("eight in a row beyond 1 sigma", lambda z: (abs(z) > 1,), 8, 8, 7, (1 - _INSIDE) ** 8),
    "western electric 1": _zone("beyond 3 sigma", 3, 1, 1),
    "western electric 2": _zone("two of three beyond 2 sigma on one side", 2, 2, 3),
    "western electric 3": _zone("four of five beyond 1 sigma on one side", 1, 4, 5),
    "western electric 4": _zone("eight in a row on one side", 0, 8, 8),
}
AVERAGES = "beyond the limits"  # the only test of moving averages
_LIMITS_ALONE = {AVERAGES: _zone(AVERAGES, 3, 1, 1)}


@dataclass(frozen=True)
class SpreadChart:
    """Spread of the points of a control chart; the arrays have one entry per point."""

    of: str  # "moving ranges", "ranges" or "standard deviations"
    points: tuple[float, ...]  # in the response's unit; the first moving range is that of the second value
    centre: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    beyond: tuple[int, ...]  # numbers of the points beyond the control limits, from 0
    p: float | None  # share of random orders of the values in which it varies as much; None: not tried


@dataclass(frozen=True)
class ControlChart:
    """Values of a response in order, or means of them, and what the tests mark."""

    points: tuple[float, ...]  # in the response's unit
    of: str  # "values", "means" of consecutive values, "subgroups" or "lots": their means
    size: int  # fewest values, or lots, in a point
    centre: float
    low: tuple[float, ...]  # control limits of each point
    high: tuple[float, ...]
    marks: dict[str, tuple[int, ...]]  # by test: numbers of the points that it marks, from 0
    by_chance: float  # expected number of marked points if nothing changes and values are normal
    kind: str = "i-mr"  # "i-mr", "xbar-r", "xbar-s" or "ewma"
    sigma: float = 0.0  # of a value within a subgroup, or of an individual, in the response's unit
    beyond: tuple[int, ...] = ()  # numbers of the points beyond the control limits
    spread: SpreadChart | None = None
    p: float | None = None  # share of random orders of the same values with as many marks; None: not tried
    left_out: int = 0  # subgroups with a single value
    texts: dict[str, str] = field(default_factory=dict)  # what each test asks

    @property
    def marked(self) -> tuple[int, ...]:
        """Numbers of all marked points, in order."""
        return tuple(sorted({at for those in self.marks.values() for at in those}))


@dataclass(frozen=True)
class _Points:
    """Points of charts of several orders of the same values, shape (orders, points)."""

    scores: Array  # distances from the centre, in standard deviations of a point
    sigma: Array  # of a value, shape (orders,)
    spread: Array  # measures of spread, with centre and limits
    centre: Array
    low: Array
    high: Array


def control_chart(
    x: Array,
    lots: NDArray[np.generic] | None = None,
    plan: ChartPlan | None = None,
    subgroups: NDArray[np.generic] | None = None,
) -> ControlChart | None:
    """Return the control chart of finite values in their order; None below 5 points, or without spread.

    With a plan the chart has its spread, and is compared with random orders of its values.
    """
    if x.size < _FEWEST_POINTS or float(np.ptp(x)) <= ROUNDING * magnitude(x):
        return None
    asked = plan or ChartPlan()
    x, sizes, left_out, of = _arranged(x, lots, subgroups, chosen=bool(asked.chart))
    size = _round_size(x.size) if of == "means" else int(sizes.min(initial=x.size))
    if of == "lots" and x.size > MOST_POINTS:  # means of consecutive lots
        size = _round_size(x.size)
        x = np.array([group.mean() for group in np.array_split(x, x.size // size)])
        sizes = np.ones(x.size, np.intp)
    if sizes.size < _FEWEST_POINTS:
        return None
    if sizes.size > LARGEST_CHART:
        raise ReportError(f"a control chart of {sizes.size} points: at most {LARGEST_CHART}; give larger subgroups")
    means = bool(sizes.max() > 1)
    ranges = bool(sizes.min() == sizes.max() <= RANGES_UP_TO)
    kind = asked.chart or ("i-mr" if not means else "xbar-r" if ranges and of == "subgroups" else "xbar-s")
    if kind != "ewma" and means == (kind == "i-mr"):
        what = "there are no subgroups" if not means else "i-mr is a chart of values without subgroups"
        raise ReportError(f'chart "{kind}": {what}; give subgroup and "xbar-r" or "xbar-s", or neither')
    measure = ("i-mr" if not means else "xbar-r" if ranges else "xbar-s") if kind == "ewma" else kind
    if measure == "xbar-r" and sizes.max() > LARGEST_FOR_RANGES:
        raise ReportError(
            f'chart "xbar-r" with {sizes.max()} values in a subgroup: a range ignores nearly all of them; at most'
            f' {LARGEST_FOR_RANGES}, or chart = "xbar-s"'
        )
    orders = x[None, :]
    if plan is not None and x.size <= _MOST_PERMUTED:  # and random orders, which are always the same
        random = np.random.Generator(np.random.PCG64(x.size)).permuted(np.tile(x, (_ORDERS, 1)), axis=1)
        orders = np.vstack([x, random])
    centre = x.mean()
    rows = _chart_points(orders, float(centre), sizes, measure, pooled=of == "means")
    if not rows.sigma[0] > 0:
        return None
    rules = _LIMITS_ALONE if kind == "ewma" else {name: RULES[name] for name in asked.rules}
    scores, wide = rows.scores, 1 / np.sqrt(sizes)
    if kind == "ewma":
        scores, wide = moving_averages(rows.scores, sizes, asked.weight)
    half, shown = 3 * rows.sigma[0] * wide, centre + scores[0] * wide * rows.sigma[0]
    marks = {name: rule.marked(scores) for name, rule in rules.items()}
    beyond = (rows.spread > rows.high) | (rows.spread < rows.low)
    counts = np.sum([found.sum(axis=-1) for found in marks.values()], axis=0)
    return ControlChart(
        points=tuple(shown.tolist()),
        of=of,
        size=size,
        centre=float(centre),
        low=tuple((centre - half).tolist()),
        high=tuple((centre + half).tolist()),
        marks={name: _numbers(found[0]) for name, found in marks.items()},
        by_chance=sum(rule.chance * max(sizes.size - rule.first, 0) for rule in rules.values()),
        kind=kind,
        sigma=float(rows.sigma[0]),
        beyond=_numbers(abs(scores[0]) > 3),
        spread=None if plan is None else _spread(rows, measure, beyond[0]),
        p=_share_as_large(counts),
        left_out=left_out,
        texts={name: rule.text for name, rule in rules.items()},
    )


def _arranged(
    x: Array, lots: NDArray[np.generic] | None, subgroups: NDArray[np.generic] | None, *, chosen: bool
) -> tuple[Array, NDArray[np.intp], int, str]:
    """Return values in order, how many are in each point, subgroups left out with one value, and what a point is of."""
    if subgroups is not None:
        order = np.argsort(subgroups, kind="stable")
        _, group, counts = np.unique(subgroups[order], return_inverse=True, return_counts=True)
        return x[order][counts[group] > 1], counts[counts > 1], int(np.sum(counts == 1)), "subgroups"
    if lots is not None and not independent(lots):
        _, number = np.unique(lots, return_inverse=True)
        means = np.bincount(number, x) / np.bincount(number)
        return means, np.ones(means.size, np.intp), 0, "lots"
    if not chosen and x.size > MOST_POINTS:
        parts = np.array_split(x, x.size // _round_size(x.size))
        return x, np.array([part.size for part in parts]), 0, "means"
    return x, np.ones(x.size, np.intp), 0, "values"


def _chart_points(x: Array, mean: float, sizes: NDArray[np.intp], measure: str, *, pooled: bool) -> _Points:
    """Return the points of charts of orders of values, shape (orders, n), less the mean of the values."""
    if measure == "i-mr":
        x = x - mean
        ranges = np.abs(np.diff(x, axis=-1))
        sigma = ranges.mean(axis=-1) / d2(2)
        of_spread, centres, spreads = ranges, np.array([d2(2)]), np.array([d3(2)])
        points = x
    else:
        of_range = measure == "xbar-r"
        points, squares, by_range = _by_point(x, mean, sizes)
        of_spread = by_range if of_range else np.sqrt(squares / np.maximum(sizes - 1, 1))
        constants = {n: (d2(n), d3(n)) if of_range else (c4(n), sigma_of_std(n)) for n in set(sizes.tolist())}
        centres, spreads = np.array([constants[int(n)] for n in sizes]).T
        weights = (centres / spreads) ** 2
        sigma = of_spread @ (weights / centres) / weights.sum()
        if pooled:
            sigma = np.sqrt(squares.sum(axis=-1) / (sizes.sum() - sizes.size))
    with np.errstate(invalid="ignore", divide="ignore"):
        scores = points * np.sqrt(sizes) / sigma[:, None]
    centre = sigma[:, None] * centres
    half = 3 * sigma[:, None] * spreads
    shape = of_spread.shape
    low, centre, high = (np.broadcast_to(part, shape) for part in (np.maximum(centre - half, 0), centre, centre + half))
    return _Points(scores, sigma, of_spread, centre, low, high)


def _by_point(x: Array, mean: float, sizes: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Return of the values of each point their mean, sum of squares around it and range, shape (orders, points)."""
    found, first = [], 0
    for size in sizes.tolist():  # one point after the other: no further column of millions is in memory
        part = x[:, first : first + size] - mean
        middle, first = part.mean(axis=-1), first + size
        found.append((middle, np.square(part - middle[:, None]).sum(axis=-1), np.ptp(part, axis=-1)))
    points, squares, ranges = np.moveaxis(np.array(found), 0, -1)
    return points, squares, ranges


def moving_averages(scores: Array, sizes: NDArray[np.intp], weight: float) -> tuple[Array, Array]:
    """Return the moving averages of points in their standard deviations, and these for values of sigma 1.

    ``z_i = w x_i + (1 - w) z_(i-1)`` from the centre on; the variance of z_i follows the same recursion.
    """
    points, average = scores / np.sqrt(sizes), np.zeros(scores.shape[0])
    found, variance, variances = np.empty_like(points), 0.0, np.empty(sizes.size)
    for i in range(sizes.size):
        average = weight * points[:, i] + (1 - weight) * average
        variance = weight**2 / float(sizes[i]) + (1 - weight) ** 2 * variance
        found[:, i], variances[i] = average, variance
    return found / np.sqrt(variances), np.sqrt(variances)


def _spread(rows: _Points, measure: str, beyond: Marks) -> SpreadChart:
    """Return the chart of the spread of the first order."""
    name = {"i-mr": "moving ranges", "xbar-r": "ranges", "xbar-s": "standard deviations"}[measure]
    points, centre, low, high = (tuple(part[0].tolist()) for part in (rows.spread, rows.centre, rows.low, rows.high))
    p = _share_as_large((rows.spread / rows.centre).std(axis=-1))
    return SpreadChart(name, points, centre, low, high, _numbers(beyond), p)


def _share_as_large(measures: Array) -> float | None:
    """Return in which share of the orders a measure is as large as in the first; None with one order."""
    return float(np.mean(measures >= measures[0] * (1 - 1e-12))) if measures.size > 1 else None


def _numbers(marks: Marks) -> tuple[int, ...]:
    return tuple(np.flatnonzero(marks).tolist())


def _round_size(n: int) -> int:
    """Return the smallest number 1, 2 or 5 times a power of ten by which n values make at most 60 points."""
    power = 1
    while True:
        for factor in (1, 2, 5):
            if n <= MOST_POINTS * factor * power:
                return factor * power
        power *= 10


# Convergence of an index with the number of samples, and agreement of both halves of a campaign.

_POINTS, _FIRST = 60, 10
# Halves of a campaign that differ by more standard errors than this do not come from one distribution.
DRIFT_BAR = 4.0


@dataclass(frozen=True)
class Convergence:
    """An index over the first n samples, for increasing n."""

    index: str  # "Cpk", or "mean" without limits
    n: tuple[int, ...]  # numbers of samples, rising
    value: tuple[float, ...]  # of the first n samples; a mean is in the response's unit
    low: tuple[float, ...]  # ends of the interval by the method that is valid for the first n samples
    high: tuple[float, ...]
    # Index of the second half of the samples minus that of the first, in standard errors (delta method, any
    # distribution; with few lots, the normal quantile of the same probability). None below 40 samples, or where a half
    # has fewer than two lots.
    drift: float | None


def convergence(
    x: Array, lsl: float | None, usl: float | None, confidence: float, lots: NDArray[np.generic] | None = None
) -> Convergence | None:
    """Return how the index of finite values in order converges; None below 10, without spread or with too few lots."""
    n = x.size
    if n < _FIRST or not varies(x):
        return None
    lots = None if independent(lots) else lots
    name = "mean" if lsl is None and usl is None else "cpk"
    points = []
    # At equal ratios of n: the figure's axis is logarithmic, and a long campaign costs no more points.
    counts = np.unique(np.geomspace(_FIRST, n, _POINTS).astype(np.int64)).tolist()
    fence = Fence(lsl, usl, None, confidence)
    few, many = x[:MOST_ROWS], [count for count in counts if count > MOST_ROWS]
    differ = lots is None and varies(few)
    running = dict(zip(many, running_moments(x, many), strict=True)) if many and differ else {}
    for count in counts:
        if count in running:
            found = _point_of_moments(running[count], fence, name)
        else:
            found = _point(x[:count], fence, None if lots is None else lots[:count], name)
        if found is not None:
            points.append((count, *found))
    if not points:
        return None
    n_first, value, low, high = zip(*points, strict=True)
    return Convergence("mean" if name == "mean" else "Cpk", n_first, value, low, high, drift(x, lsl, usl, lots))


def _point(x: Array, fence: Fence, lots: NDArray[np.generic] | None, name: str) -> tuple[float, float, float] | None:
    """Return an index of the values and its interval; None without spread or with too few lots."""
    given = Values(x)
    mean, std = given.location["mean"], given.location["std"]
    if std == 0:
        return None
    value = mean if name == "mean" else cpk(mean, std, fence.lsl, fence.usl)
    method = choose_method(given, None if lots is None else describe_lots(x, lots))
    if method.name == NORMAL:
        return value, *_by_normal_theory(value, std, x.size, fence.confidence, name)
    precision = precision_by(method, given, lots, fence.confidence)
    interval = (
        None if precision is None else robust_intervals(precision, fence.lsl, fence.usl, None)[f"{name}_interval"]
    )
    return None if interval is None else (value, *interval)


def _point_of_moments(moments: OwnMoments, fence: Fence, name: str) -> tuple[float, float, float] | None:
    """Return what `_point` does, of many independent values that differ."""
    std = math.sqrt(moments.square * moments.n / (moments.n - 1))
    value = moments.mean if name == "mean" else cpk(moments.mean, std, fence.lsl, fence.usl)
    precision = precision_of_moments(moments, fence.confidence)
    if precision is None:
        return value, *_by_normal_theory(value, std, moments.n, fence.confidence, name)
    interval = robust_intervals(precision, fence.lsl, fence.usl, None)[f"{name}_interval"]
    return None if interval is None else (value, *interval)


def _by_normal_theory(value: float, std: float, n: int, confidence: float, name: str) -> tuple[float, float]:
    """Return the interval of a mean, or of a Cpk, of n normal values."""
    half = cpk_half_width(value, n, confidence)
    return mean_interval(value, std, n, confidence) if name == "mean" else (value - half, value + half)


def drift(x: Array, lsl: float | None, usl: float | None, lots: NDArray[np.generic] | None) -> float | None:
    """Return the difference of the index between the halves in standard errors; see `Convergence.drift`."""
    half = x.size // 2
    if lots is not None:  # a lot in both halves would hide a difference between them: where one ends, or nowhere
        begins = np.flatnonzero(lots[1:] != lots[:-1]) + 1
        half = int(begins[np.argmin(np.abs(begins - half))]) if begins.size else 0
    if half < 2 * _FIRST or x.size - half < 2 * _FIRST:
        return None
    (first, error, freedom), (second, other, of_other) = (
        _with_error(x[part], lsl, usl, None if lots is None else lots[part])
        for part in (slice(half), slice(half, None))
    )
    both = math.hypot(error, other)
    if not 0 < both < math.inf:
        return None
    errors = (second - first) / both
    if math.isinf(freedom) and math.isinf(of_other):
        return errors
    # Few lots know their error badly. The bar is in normal standard errors, so Student's tail is converted.
    welch = both**4 / (error**4 / freedom + other**4 / of_other)
    # Not 0: its normal quantile would be infinite.
    tail = max(float(stdtr(welch, -abs(errors))), math.ulp(0.0))
    return math.copysign(float(ndtri(tail)), errors)


def _with_error(
    x: Array, lsl: float | None, usl: float | None, lots: NDArray[np.generic] | None
) -> tuple[float, float, float]:
    """Return the index of values, its standard error and the degrees of freedom of the error."""
    mean, std = float(np.mean(x)), standard_deviation(x)
    if std == 0 or (lsl is None and usl is None):
        return mean, *mean_error(x, lambda piece: piece - mean, lots)
    index = cpk(mean, std, lsl, usl)
    lower = usl is None or (lsl is not None and mean - lsl < usl - mean)
    return index, *mean_error(x, lambda piece: cpk_influence(piece - mean, std, index, lower=lower), lots)
