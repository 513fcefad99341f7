"""Measurement system analysis: gauge repeatability and reproducibility by analysis of variance, bias and linearity.

Crossed: every operator measures every part; nested: each operator has parts of their own, as where a test destroys
them; without operators: repeatability alone. The variance components are those of random effects from the mean squares
(AIAG, Measurement Systems Analysis, 4th edition, chapter III; Burdick, Borror, Montgomery 2005), 0 where they come out
negative. The interaction is pooled with the repeatability where it is not significant (p above 0.05).

Intervals are generalized ones (Weerahandi 1993; Hamada and Weerahandi 2000): each mean square is divided by a
chi-square value over its degrees of freedom, 20,000 times, and a number is computed from each set.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc, fdtrc, stdtr, stdtrit

from reporting.arrays import Array
from reporting.capability.indices import distance_to_limit
from reporting.capability.intervals import Interval
from reporting.errors import ReportError, check_limits, production_batches, real_number, series

SIX = 6.0  # sigmas of a spread, as AIAG compares it with a tolerance
POOLED_ABOVE = 0.05  # p of the interaction
ACCEPTABLE, UNACCEPTABLE, FEWEST_CATEGORIES = 0.1, 0.3, 5  # AIAG: R&R over study variation or tolerance; ndc
DRAWS = 20_000
EQUAL = 1e-20  # share of the squares that is rounding
FEW_OPERATORS = 3
_UNEQUAL_P = 0.01


@dataclass(frozen=True)
class AnovaRow:
    """A line of the analysis of variance."""

    source: str
    freedom: int
    squares: float  # in the square of the unit
    f: float | None  # over the mean square by which it is tested
    p: float | None

    @property
    def mean_square(self) -> float:
        """Sum of squares per degree of freedom."""
        return self.squares / self.freedom


@dataclass(frozen=True)
class Component:
    """A source of variation, with intervals; a number that is not defined is None."""

    name: str
    std: float  # in the unit of the values
    std_interval: Interval
    contribution: float  # share of the total variance
    study: float  # share of the total sigma: % study variation
    study_interval: Interval
    tolerance: float | None  # six sigmas over the tolerance
    tolerance_interval: Interval | None


@dataclass(frozen=True)
class GaugeStudy:
    """Repeatability and reproducibility of a measuring system."""

    design: str  # "crossed", "nested" or "one operator"
    parts: int  # in all
    operators: int
    trials: int  # of each part by each operator
    anova: tuple[AnovaRow, ...]
    components: tuple[Component, ...]  # of "gauge R&R", its parts, "part" and "total"
    ndc: int  # number of distinct categories, ``sqrt(2) part / R&R``, rounded down, at least 1
    ndc_interval: tuple[int, int]
    freedom: float  # effective degrees of freedom of R&R (Satterthwaite)
    confidence: float
    verdict: str  # by AIAG's bars, in words
    notes: tuple[str, ...]

    def of(self, name: str) -> Component:
        """Return a component by name."""
        return next(each for each in self.components if each.name == name)


@dataclass(frozen=True)
class Bias:
    """Deviation of the mean of measurements from one reference value."""

    reference: float
    n: int
    bias: float
    std: float | None  # repeatability; None with one measurement
    interval: Interval | None
    p: float | None  # of no bias (Student's t)


@dataclass(frozen=True)
class Linearity:
    """How the bias changes over the reference values: a straight line through all deviations."""

    slope: float
    slope_interval: Interval
    slope_p: float
    intercept: float  # bias at the reference 0
    intercept_interval: Interval
    intercept_p: float
    std: float  # of the deviations from the line
    r2: float
    lack_of_fit_p: float | None  # of a straight line against the means; None with fewer than 3 reference values


@dataclass(frozen=True)
class BiasStudy:
    """Bias of a measuring system at its reference values, and over them."""

    values: tuple[Bias, ...]  # in the order of the reference values
    linearity: Linearity | None  # None with one reference value
    confidence: float
    notes: tuple[str, ...]


def gauge_repeatability(
    values: ArrayLike,
    parts: ArrayLike,
    operators: ArrayLike | None = None,
    *,
    nested: bool = False,
    tolerance: float | None = None,
    confidence: float = 0.95,
) -> GaugeStudy:
    """Return the study of measurements, shape (n,), of parts by operators.

    ReportError: a value is not finite; the study is not balanced, or too small; the tolerance is not above 0.
    """
    x = _finite(values)
    of_part, part_names = _codes(parts, x.size, "part")
    of_operator, operator_names = _codes(np.zeros(x.size) if operators is None else operators, x.size, "operator")
    confidence = real_number("confidence", confidence)
    check_limits(None, None, confidence)
    tolerance = None if tolerance is None else real_number("tolerance", tolerance)
    if tolerance is not None and not 1e-30 < tolerance < 1e30:
        raise ReportError(f"tolerance = {tolerance}: must be above 0; it is the distance between the limits")
    table = np.zeros((part_names.size, operator_names.size), int)
    np.add.at(table, (of_part, of_operator), 1)
    met = table > 0
    if nested and (met.sum(axis=1) > 1).any():
        part = part_names[int(np.argmax(met.sum(axis=1) > 1))]
        raise ReportError(f"part {part}: several operators measured it, so the study is crossed; leave nested out")
    if not nested and not met.all():
        part, operator = np.argwhere(~met)[0]
        raise ReportError(
            f"part {part_names[part]}: operator {operator_names[operator]} did not measure it; complete the study, or"
            " say nested if each operator has parts of their own"
        )
    trials, per_operator = int(table[met].min()), met.sum(axis=0)
    if table[met].max() != trials or per_operator.min() != per_operator.max():
        part, operator = np.argwhere(met & (table != trials))[0] if table[met].max() != trials else (0, 0)
        what = (
            f"part {part_names[part]} has {table[part, operator]} measurements, another part {trials}"
            if table[met].max() != trials
            else f"operators have {per_operator.min()} to {per_operator.max()} parts"
        )
        raise ReportError(f"the study is not balanced: {what}; measure each equally often")
    if trials < 2 or per_operator[0] < 2:
        raise ReportError(
            f"{per_operator[0]} parts and {trials} trials: at least 2 parts, each measured at least twice, are needed"
        )
    design = "nested" if nested else "crossed" if operator_names.size > 1 else "one operator"
    if design == "nested" and operator_names.size < 2:
        raise ReportError("nested: there is one operator; leave nested out")
    order = np.lexsort((of_part, of_operator))
    cube = (x - x.mean())[order].reshape(operator_names.size, int(per_operator[0]), trials)
    anova, variances = _anova(cube, design)
    return _study(cube, design, anova, variances, tolerance, confidence)


_Variances = Callable[[dict[str, Array]], dict[str, Array]]


def _anova(cube: Array, design: str) -> tuple[tuple[AnovaRow, ...], _Variances]:
    """Return the analysis of variance of values (operators, parts, trials), and components from mean squares."""
    o, p, r = cube.shape
    cells = cube.mean(axis=2)
    by_operator, by_part = cells.mean(axis=1), cells.mean(axis=0)
    operator = ("operator", o - 1, p * r * float(np.sum((by_operator - cube.mean()) ** 2)))
    repeated = ("repeatability", o * p * (r - 1), float(np.sum((cube - cells[:, :, None]) ** 2)))
    if design != "crossed":
        part = ("part", o * (p - 1), r * float(np.sum((cells - by_operator[:, None]) ** 2)))
        if design == "one operator":
            return _tested([part, repeated], {"part": ("repeatability", r)})
        return _tested([operator, part, repeated], {"operator": ("part", p * r), "part": ("repeatability", r)})
    part = ("part", p - 1, o * r * float(np.sum((by_part - cube.mean()) ** 2)))
    crossed = r * float(np.sum((cells - by_operator[:, None] - by_part + cube.mean()) ** 2))
    name = "operator by part"
    both = (name, (o - 1) * (p - 1), crossed)
    by = {"operator": (name, p * r), name: ("repeatability", r), "part": (name, o * r)}
    full = _tested([operator, part, both, repeated], by)
    if (full[0][2].p or 0.0) <= POOLED_ABOVE:
        return full
    pooled = ("repeatability", both[1] + repeated[1], both[2] + repeated[2])
    by = {"operator": ("repeatability", p * r), "part": ("repeatability", o * r)}
    return _tested([operator, part, pooled], by)


def _tested(
    sources: list[tuple[str, int, float]], by: dict[str, tuple[str, int]]
) -> tuple[tuple[AnovaRow, ...], _Variances]:
    """Return the lines of an analysis of variance, and the variance of each source from the mean squares.

    A source is tested by the mean square of another, which is also what its own exceeds by a multiple of its variance.
    """
    of = {name: (freedom, squares / freedom) for name, freedom, squares in sources}
    rows = []
    for name, freedom, squares in sources:
        f = p = None
        if name in by and of[by[name][0]][1] > 0:
            f = of[name][1] / of[by[name][0]][1]
            p = float(fdtrc(freedom, of[by[name][0]][0], f))
        rows.append(AnovaRow(name, freedom, squares, f, p))
    return tuple(rows), lambda s: {
        "repeatability": s["repeatability"],
        **{name: (s[name] - s[other]) / multiple for name, (other, multiple) in by.items()},
    }


def _study(
    cube: Array,
    design: str,
    anova: tuple[AnovaRow, ...],
    variances: _Variances,
    tolerance: float | None,
    confidence: float,
) -> GaugeStudy:
    """Return the study from its analysis of variance; the first entry of each array is the estimate."""
    rng = np.random.Generator(np.random.PCG64(sum(row.freedom for row in anova)))
    squares = {row.source: np.r_[row.mean_square, row.squares / rng.chisquare(row.freedom, DRAWS)] for row in anova}
    raw = variances(squares)
    if anova[-1].squares <= EQUAL * sum(row.squares for row in anova):
        raise ReportError(
            "all measurements of each part are equal: the resolution of the gauge is too coarse for a study"
        )
    parts = {name: np.maximum(each, 0.0) for name, each in raw.items()}
    gauge = sum((each for name, each in parts.items() if name != "part"), np.zeros(DRAWS + 1))
    total = gauge + parts["part"]
    named = {"gauge R&R": gauge, **{name: each for name, each in parts.items() if name != "part"}}
    named |= {"part": parts["part"], "total": total}
    tail = (1 - confidence) / 2

    def interval(draws: Array) -> Interval:
        low, high = np.quantile(draws[1:], (tail, 1 - tail))
        return float(low), float(high)

    components = tuple(
        Component(
            name,
            math.sqrt(each[0]),
            interval(np.sqrt(each)),
            float(each[0] / total[0]),
            math.sqrt(each[0] / total[0]),
            interval(np.sqrt(each / total)),
            None if tolerance is None else SIX * math.sqrt(each[0]) / tolerance,
            None if tolerance is None else interval(SIX * np.sqrt(each) / tolerance),
        )
        for name, each in named.items()
    )
    categories = np.sqrt(2 * parts["part"] / gauge)
    low, high = interval(categories)
    ndc = max(1, math.floor(categories[0]))
    o, p, r = cube.shape
    return GaugeStudy(
        design=design,
        parts=p * (o if design == "nested" else 1),
        operators=o,
        trials=r,
        anova=anova,
        components=components,
        ndc=ndc,
        ndc_interval=(max(1, math.floor(low)), max(1, math.floor(high))),
        freedom=_freedom(anova, variances),
        confidence=confidence,
        verdict=_judged(components[0], ndc),
        notes=_notes(cube, design, raw),
    )


def _freedom(anova: tuple[AnovaRow, ...], variances: _Variances) -> float:
    """Return Satterthwaite's degrees of freedom of the variance of R&R, a sum of multiples of mean squares."""
    zeros = {row.source: np.zeros(1) for row in anova}
    terms = []
    for row in anova:
        one = variances({**zeros, row.source: np.ones(1)})
        multiple = sum(float(each[0]) for name, each in one.items() if name != "part")
        terms.append((multiple * row.mean_square, row.freedom))
    total, spread = sum(term for term, _ in terms), sum(term**2 / freedom for term, freedom in terms)
    return max(total**2 / spread, 1.0)


def _judged(gauge: Component, ndc: int) -> str:
    """Return what AIAG says of a gauge, by its share of the tolerance, or else of the study variation."""
    share, of = (gauge.study, "study variation") if gauge.tolerance is None else (gauge.tolerance, "tolerance")
    word = "acceptable" if share < ACCEPTABLE else "not acceptable" if share > UNACCEPTABLE else "may be acceptable"
    ends = gauge.study_interval if gauge.tolerance_interval is None else gauge.tolerance_interval
    certain = all((end < ACCEPTABLE, end > UNACCEPTABLE) == (share < ACCEPTABLE, share > UNACCEPTABLE) for end in ends)
    few = f"; it tells {ndc} categories of parts apart, {FEWEST_CATEGORIES} are needed" * (ndc < FEWEST_CATEGORIES)
    return f"{word}{'' if certain else ', not certain'}: R&R is {100 * share:.1f} % of the {of}{few}"


def _notes(cube: Array, design: str, raw: dict[str, Array]) -> tuple[str, ...]:
    """Return what the study does not show, and where its assumptions do not hold."""
    notes, (o, _, r) = [], cube.shape
    negative = [name for name, each in raw.items() if each[0] < 0]
    if negative:
        notes.append(f"The variance of {', '.join(negative)} comes out negative and counts as 0: it is not seen.")
    if design != "one operator" and o <= FEW_OPERATORS:
        notes.append(f"{o} operators say little about how operators differ: the upper ends of the intervals are high.")
    if design == "one operator":
        notes.append("One operator: what operators add is not part of R&R.")
    if design == "nested":
        notes.append("Nested: how parts differ within a batch counts as repeatability where a test destroys them.")
    notes.append("% study variation and categories hold for parts that vary as those of the study do.")
    ranges = np.ptp(cube, axis=2)
    if np.mean(ranges <= 1e-9 * ranges.max()) > 0.25:
        notes.append(
            "More than a quarter of the repeated measurements are equal: the resolution of the gauge is coarse."
        )
    within = np.sum((cube - cube.mean(axis=2, keepdims=True)) ** 2, axis=(1, 2)) / (cube.shape[1] * (r - 1))
    if o > 1 and within.min() > 0:
        nu, k = cube.shape[1] * (r - 1), o
        statistic = k * nu * math.log(within.mean()) - nu * float(np.sum(np.log(within)))
        p = float(chdtrc(k - 1, statistic / (1 + (k + 1) / (3 * k * nu))))
        if p < _UNEQUAL_P:
            notes.append(
                f"Operators repeat differently well (Bartlett, p = {p:.2g}): one repeatability does not hold for all."
            )
    return tuple(notes)


def gauge_bias(values: ArrayLike, references: ArrayLike, *, confidence: float = 0.95) -> BiasStudy:
    """Return bias and linearity of measurements, shape (n,), of parts with known reference values, shape (n,).

    ReportError: a value is not finite, or there are too few.
    """
    x, known = _finite(values), _finite(references)
    if known.shape != x.shape:
        raise ReportError(f"{known.size} reference values for {x.size} measurements; each needs one")
    confidence = real_number("confidence", confidence)
    check_limits(None, None, confidence)
    if x.size < 3:
        raise ReportError(f"{x.size} measurements are too few for a bias; 10 or more are usual")
    levels, group = np.unique(known, return_inverse=True)
    off = x - known
    found = []
    for level in range(levels.size):
        here = off[group == level]
        std, interval, p = None, None, None
        if here.size > 1:
            std = float(here.std(ddof=1))
            half = float(stdtrit(here.size - 1, 0.5 + confidence / 2)) * std / math.sqrt(here.size)
            interval = (float(here.mean()) - half, float(here.mean()) + half)
            t = abs(float(here.mean())) / (std / math.sqrt(here.size)) if std > 0 else math.inf
            p = 2 * float(stdtr(here.size - 1, -t)) if std > 0 or here.mean() else 1.0
        found.append(Bias(float(levels[level]), here.size, float(here.mean()), std, interval, p))
    notes = ["The bias includes that of the reference values."]
    if min(each.n for each in found) < 10:
        notes.append("Fewer than 10 measurements of a reference value: its interval is wide.")
    line = _line(known, off, group, levels.size, confidence) if levels.size > 1 and x.size > levels.size else None
    if line and line.lack_of_fit_p is not None and line.lack_of_fit_p < 0.05:
        notes.append(
            f"The bias is no straight line (lack of fit, p = {line.lack_of_fit_p:.2g}): correct it by a table."
        )
    return BiasStudy(tuple(found), line, confidence, tuple(notes))


def _line(known: Array, off: Array, group: NDArray[np.intp], levels: int, confidence: float) -> Linearity:
    """Return the least-squares line of deviations over reference values; each has normal errors of one sigma."""
    n, centre = off.size, float(known.mean())
    spread = float(np.sum((known - centre) ** 2))
    slope = float(np.sum((known - centre) * off)) / spread
    intercept = float(off.mean()) - slope * centre
    residual = off - intercept - slope * known
    squares, total = float(np.sum(residual**2)), float(np.sum((off - off.mean()) ** 2))
    std = math.sqrt(squares / (n - 2))
    t = float(stdtrit(n - 2, 0.5 + confidence / 2))
    errors = std / math.sqrt(spread), std * math.sqrt(1 / n + centre**2 / spread)

    def tested(value: float, error: float) -> tuple[Interval, float]:
        p = 2 * float(stdtr(n - 2, -abs(value) / error)) if error > 0 else 0.0
        return (value - t * error, value + t * error), p

    lack = None
    if levels > 2:
        means = np.bincount(group, off) / np.bincount(group)
        pure = float(np.sum((off - means[group]) ** 2))
        if pure > 0:
            lack = float(fdtrc(levels - 2, n - levels, (squares - pure) / (levels - 2) / (pure / (n - levels))))
    return Linearity(
        slope, *tested(slope, errors[0]), intercept, *tested(intercept, errors[1]), std,
        1 - squares / total if total > 0 else 0.0, lack,
    )  # fmt: skip


def _finite(values: ArrayLike) -> Array:
    """Return values as numbers; ReportError if one is not finite, or there are none."""
    x = series(values)
    if not x.size:
        raise ReportError("there are no measurements; give one a row")
    if not np.isfinite(x).all() or np.abs(x).max() > 1e30:
        at = int(np.argmin(np.isfinite(x) & (np.abs(x) <= 1e30)))
        raise ReportError(
            f"measurement {at + 1} of {x.size} is {x[at]:g}; give a number in each row, or leave the row out"
        )
    return x


def _codes(names: ArrayLike, n: int, what: str) -> tuple[NDArray[np.intp], NDArray[np.generic]]:
    given = production_batches(names, n)
    if given is None:
        raise ReportError(f"the {what} of each measurement is not given; give one a row")
    unique, codes = np.unique(given, return_inverse=True)
    return codes, unique


# What the measuring system adds to measured values, and what it leaves undecided near the limits.
#
# Sigma of the process behind the gauge: ``sqrt(s^2 - g^2)``, with g the sigma of repeatability and reproducibility,
# because errors of measurement add to the parts' variance. Its index and interval (generalized, as above) are for
# normal, independent values; where these are not, or where the gauge may be all that varies, the interval is withheld.
#
# Conformity by ISO 14253-1: within the limits less the expanded uncertainty U a part is proved to conform, beyond the
# limits plus U proved not to; between them nothing is proved.


@dataclass(frozen=True)
class BehindGauge:
    """The process without the errors of its gauge; None where it is not defined."""

    gauge: float  # sigma of the gauge, in the unit of the values
    share: float  # of the gauge in the variance of the values
    of_tolerance: float | None  # six sigmas of the gauge over the tolerance; None with one limit
    std: float | None  # sigma of the process; None if that of the gauge is no smaller than that of the values
    cpk: float | None
    cpk_interval: Interval | None
    note: str  # why there is no interval; may be empty


@dataclass(frozen=True)
class Conformity:
    """What measurements prove of the parts, with an expanded uncertainty."""

    uncertainty: float  # U, in the unit of the values
    low: float | None  # zone in which a value proves conformity; None without that limit
    high: float | None
    conforming: int  # parts proved to conform
    nonconforming: int  # parts proved not to
    undecided: int


def behind_gauge(
    x: Array, lsl: float | None, usl: float | None, gauge: float, freedom: float | None, confidence: float, doubt: str
) -> BehindGauge | None:
    """Return the process behind a gauge of known sigma, or of one known with so many degrees of freedom.

    No interval is given if `doubt` says why it would not hold. None below 3 values, or without spread.
    """
    n = x.size
    if n < 3 or not (std := float(x.std(ddof=1))) > 0:
        return None
    mean, ratio = float(x.mean()), (gauge / std) ** 2
    of_tolerance = None if lsl is None or usl is None else 6 * gauge / (usl - lsl)
    if ratio >= 1:
        note = "The gauge varies as much as the values: they say nothing of the process."
        return BehindGauge(gauge, ratio, of_tolerance, None, None, None, note)
    process = std * math.sqrt(1 - ratio)
    if lsl is None and usl is None:
        return BehindGauge(gauge, ratio, of_tolerance, process, None, None, "")
    cpk = distance_to_limit(mean, lsl, usl) / (3 * process)
    if doubt:
        return BehindGauge(gauge, ratio, of_tolerance, process, cpk, None, doubt)
    rng = np.random.Generator(np.random.PCG64(n))
    observed = std**2 * (n - 1) / rng.chisquare(n - 1, DRAWS)
    means = mean + rng.normal(size=DRAWS) * np.sqrt(observed / n)
    of_gauge = gauge**2 * (1.0 if freedom is None else freedom / rng.chisquare(freedom, DRAWS))
    left = observed - of_gauge
    tail = (1 - confidence) / 2
    if np.mean(left <= 0) >= tail:
        note = "The gauge may be all that varies: the index of the process has no upper end"
        note += "; measure better or more parts."
        return BehindGauge(gauge, ratio, of_tolerance, process, cpk, None, note)
    near = np.minimum(math.inf if lsl is None else means - lsl, math.inf if usl is None else usl - means)
    with np.errstate(divide="ignore"):
        draws = near / (3 * np.sqrt(np.maximum(left, 0.0)))
    low, high = np.quantile(draws, (tail, 1 - tail))
    return BehindGauge(gauge, ratio, of_tolerance, process, cpk, (float(low), float(high)), "")


def conformity(x: Array, lsl: float | None, usl: float | None, uncertainty: float) -> Conformity | None:
    """Return what values prove of their parts; None without a limit."""
    if lsl is None and usl is None:
        return None
    low, high = (-math.inf if lsl is None else lsl), (math.inf if usl is None else usl)
    conforming = int(np.count_nonzero((x >= low + uncertainty) & (x <= high - uncertainty)))
    beyond = int(np.count_nonzero((x < low - uncertainty) | (x > high + uncertainty)))
    zone = None if lsl is None else lsl + uncertainty, None if usl is None else usl - uncertainty
    return Conformity(uncertainty, *zone, conforming, beyond, x.size - conforming - beyond)
