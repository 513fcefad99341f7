"""Comparison of two campaigns: which responses differ, by how much, and whether chance explains the difference.

Means are compared by Welch's t. Standard deviations are compared by their ratio and by Levene's test around the medians
(Brown, Forsythe 1974), which holds for any distribution; the F test, which needs normal distributions, is added.
Distributions are compared by the test of Mann and Whitney. With 30,000 samples nearly every difference is significant,
so each test comes with the size of the difference.
The intervals of sigmas and Cpk follow from the intervals of each campaign (Zou and Donner 2008), so they hold for any
distribution and for production lots. The tests assume independent values: with lots they are left out, and the
interval of the difference of the means is computed in the same way as the others.
"""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc

from reporting.arrays import ROUNDING, Array
from reporting.capability.intervals import Interval, fisher_interval, share_interval, welch
from reporting.capability.summary import Capability, capability
from reporting.errors import ReportError
from reporting.samples import OK, Samples, counts_by_status, judged_counts, why_no_verdict
from reporting.shape.histogram import Histogram, histogram
from reporting.spec import ReportSpec, ResponseSpec

# Cohen's (1988) words for d; below the first threshold the difference has no practical importance.
NEGLIGIBLE, SMALL, MEDIUM = 0.2, 0.5, 0.8
_OF_LOTS = "Values of a production lot are not independent. The intervals allow for this, the tests do not."


@dataclass(frozen=True)
class ResponseComparison:
    """One response in this campaign and in the other; a number is None where it is undefined."""

    response: str
    unit: str
    n: int  # values
    n_other: int
    capability: Capability  # each campaign's capability has its own limits
    capability_other: Capability
    mean_difference: float | None = None  # this campaign minus the other, in the unit of the response (Welch)
    mean_interval: Interval | None = None
    t_p: float | None = None  # Welch's test of equal means
    effect: float | None = None  # Cohen's d: the difference of the means in pooled standard deviations
    effect_word: str = ""  # "negligible", "small", "medium", "large"
    std_ratio: float | None = None  # this campaign divided by the other
    std_ratio_interval: Interval | None = None  # holds for any distribution with a fourth moment
    f_p: float | None = None
    levene_p: float | None = None  # around the medians (Brown and Forsythe)
    # probability that a value of this campaign exceeds one of the other, where equal ones count half; 0.5: alike
    superiority: float | None = None
    mann_whitney_p: float | None = None
    cpk_difference: float | None = None  # this campaign minus the other
    cpk_interval: Interval | None = None
    histogram: Histogram | None = None  # both histograms have the same edges
    histogram_other: Histogram | None = None
    notes: tuple[str, ...] = ()  # why numbers are None, and cautions


@dataclass(frozen=True)
class Comparison:
    """Comparison of a campaign with another one."""

    campaign: str  # id of the other campaign
    title: str  # of the other campaign
    samples: int  # finished ones of the other campaign
    failed: int  # of the other campaign
    responses: tuple[ResponseComparison, ...]  # of both campaigns, in the order of this one
    only_here: tuple[str, ...]
    only_there: tuple[str, ...]
    no_verdict: tuple[str, ...] = ()  # sentences that say why a campaign has no verdict: too many of its samples failed


def compare(
    samples: Samples, spec: ReportSpec, other: Samples, other_spec: ReportSpec, confidence: float
) -> Comparison:
    """Compare two campaigns, response by response.

    ReportError: they have no response in common, or a response has different units.
    """
    theirs = {r.name: r for r in other_spec.responses}
    shared = [(r, theirs[r.name]) for r in spec.responses if r.name in theirs]
    if not shared:
        raise ReportError(
            f"{spec.campaign} and {other_spec.campaign} have no common response; compare campaigns of one mechanism"
        )
    for mine, their in shared:
        if mine.unit != their.unit:
            raise ReportError(f"response {mine.name}: unit {mine.unit} here, {their.unit} in {other_spec.campaign}")
    return Comparison(
        campaign=other_spec.campaign,
        title=other_spec.title,
        samples=other.sample.size,
        failed=sum(
            count
            for status, count in judged_counts(counts_by_status(other), other_spec.max_not_assemblable).items()
            if status != OK
        ),
        responses=tuple(_response(mine, their, samples, other, confidence) for mine, their in shared),
        only_here=tuple(r.name for r in spec.responses if r.name not in theirs),
        only_there=tuple(name for name in theirs if name not in {r.name for r in spec.responses}),
        no_verdict=tuple(
            f"No verdict on {of.campaign}: {why}"
            for each, of in ((samples, spec), (other, other_spec))
            if (why := why_no_verdict(judged_counts(counts_by_status(each), of.max_not_assemblable), of.min_ok))
        ),
    )


def _response(
    mine: ResponseSpec, their: ResponseSpec, samples: Samples, other: Samples, confidence: float
) -> ResponseComparison:
    (a, a_lots), (b, b_lots) = (values_of(s, mine.name) for s in (samples, other))
    notes = []
    if (mine.lsl, mine.usl) != (their.lsl, their.usl):
        notes.append("The campaigns have different limits; each index uses those of its own campaign.")
    base = ResponseComparison(
        mine.name, mine.unit, a.size, b.size,
        capability(a, mine.lsl, mine.usl, mine.target, confidence, a_lots, ordered=False),
        capability(b, their.lsl, their.usl, their.target, confidence, b_lots, ordered=False),
    )  # fmt: skip
    fields: dict[str, object] = {}
    if a.size < 2 or b.size < 2:
        notes.append("Fewer than two values in a campaign: nothing to compare.")
    elif not (_varies(a) and _varies(b)):
        notes.append("The response does not vary in one of the campaigns: nothing to test.")
        fields = {"mean_difference": float(a.mean() - b.mean())}
    else:
        fields = {**_means(a, b, confidence), **_spreads(a, b, base), **_indices(base)}
        if base.capability.lots is not None or base.capability_other.lots is not None:
            notes.append(_OF_LOTS)
            means = base.capability.mean_interval, base.capability_other.mean_interval
            fields |= dict.fromkeys(("t_p", "f_p", "levene_p", "mann_whitney_p"))
            fields["mean_interval"] = of_difference((float(a.mean()), float(b.mean())), means)
    if a.size and b.size:
        whole = histogram(np.concatenate([a, b]), mine.lsl, mine.usl)
        edges = np.asarray(whole.edges if whole else (0.0, 1.0))
        for name, values in (("histogram", a), ("histogram_other", b)):
            fields[name] = Histogram(tuple(edges.tolist()), tuple(np.histogram(values, edges)[0].tolist()))
    return ResponseComparison(**{**vars(base), **fields, "notes": tuple(notes)})  # type: ignore[arg-type]


def values_of(samples: Samples, name: str) -> tuple[Array, NDArray[np.int64] | None]:
    """Return the finite values of a response over the ok samples, and their production lots."""
    rows = samples.ok & np.isfinite(samples.values[name])
    return samples.values[name][rows], None if samples.lots is None else samples.lots[rows]


def of_difference(values: tuple[float, float], intervals: tuple[Interval | None, Interval | None]) -> Interval | None:
    """Return the interval of a difference from the intervals of both numbers; None if one is missing."""
    (value, other), (interval, interval_other) = values, intervals
    if interval is None or interval_other is None:
        return None
    below = math.hypot(max(value - interval[0], 0.0), max(interval_other[1] - other, 0.0))
    above = math.hypot(max(interval[1] - value, 0.0), max(other - interval_other[0], 0.0))
    return value - other - below, value - other + above


def _varies(x: Array) -> bool:
    return float(np.std(x)) > ROUNDING * float(np.max(np.abs(x)))


def _means(a: Array, b: Array, confidence: float) -> dict[str, object]:
    """Return the difference of the means with its interval, test and effect size."""
    difference, interval, p_value = welch(a, b, confidence)
    squares = sum((x.size - 1) * float(np.var(x, ddof=1)) for x in (a, b))
    effect = difference / math.sqrt(squares / (a.size + b.size - 2))
    words = ((NEGLIGIBLE, "negligible"), (SMALL, "small"), (MEDIUM, "medium"))
    return {
        "mean_difference": difference,
        "mean_interval": interval,
        "t_p": p_value,
        "effect": effect,
        "effect_word": next((word for bar, word in words if abs(effect) < bar), "large"),
    }


def _spreads(a: Array, b: Array, base: ResponseComparison) -> dict[str, object]:
    """Return the ratio of the standard deviations, its interval and tests; and the test of Mann and Whitney."""
    from scipy.stats import levene, mannwhitneyu  # here because they take 1 s and only a comparison needs them

    capabilities, order = (base.capability, base.capability_other), mannwhitneyu(a, b, method="asymptotic")
    stds = float(np.std(a, ddof=1)), float(np.std(b, ddof=1))
    ratio, nu, nu_other = stds[0] / stds[1], a.size - 1, b.size - 1
    tail = float(betainc(nu / 2, nu_other / 2, nu * ratio**2 / (nu * ratio**2 + nu_other)))
    with np.errstate(all="ignore"):  # two values on each side have equal deviations from their median
        levene_p = float(levene(a, b, center="median").pvalue)
    # A ratio is a difference of logarithms, for which the intervals of both sigmas combine.
    ends = [c.std_interval and (math.log(c.std_interval[0]), math.log(c.std_interval[1])) for c in capabilities]
    logarithms = of_difference((math.log(stds[0]), math.log(stds[1])), (ends[0], ends[1]))
    return {
        "std_ratio": ratio,
        "std_ratio_interval": None if logarithms is None else (math.exp(logarithms[0]), math.exp(logarithms[1])),
        "f_p": 2 * min(tail, 1 - tail),
        "levene_p": levene_p if math.isfinite(levene_p) else None,
        "superiority": float(order.statistic) / (a.size * b.size),
        "mann_whitney_p": float(order.pvalue),
    }


def _indices(base: ResponseComparison) -> dict[str, object]:
    here, there = base.capability, base.capability_other
    if here.cpk is None or there.cpk is None:
        return {}
    interval = of_difference((here.cpk, there.cpk), (here.cpk_interval, there.cpk_interval))
    return {"cpk_difference": here.cpk - there.cpk, "cpk_interval": interval}


# Measured parts beside the simulated ones that should predict them: how far the prediction is off, at most.
#
# Differences, ratios and their intervals are those of `reporting.comparison`. A difference that is not significant
# proves no agreement: the end of its interval that is farther from none is what the model is certain to predict within.

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
TAIL = 0.005  # of the simulated values, beyond each end of their central 99 %
_FEWEST, _FEWEST_FOR_TAILS = 10, 1000  # values; simulated ones, whose quantiles are uncertain themselves


@dataclass(frozen=True)
class Prediction:
    """One response: measured less simulated; a number that is not defined is None."""

    comparison: ResponseComparison  # of the measured parts with the simulated ones
    quantiles: tuple[tuple[float, float, float], ...]  # probability, measured, simulated
    beyond: float  # share of the measured parts beyond the central 99 % of the simulated values; 0.01 if they agree
    beyond_interval: Interval | None  # None with lots, or fewer than 1,000 simulated values
    mean_within: float | None  # the mean is predicted within this, in the unit of the response
    std_within: float | None  # sigma is predicted within this factor, above 1
    verdict: str


@dataclass(frozen=True)
class PredictedCorrelation:
    """Correlation of two responses, measured and simulated."""

    first: str
    second: str
    measured: float
    simulated: float
    difference_interval: Interval


@dataclass(frozen=True)
class Validation:
    """What measured parts say of a model."""

    predictions: tuple[Prediction, ...]
    correlations: tuple[PredictedCorrelation, ...]  # empty with lots
    notes: tuple[str, ...]


def validation(
    parts: Samples, of_parts: ReportSpec, samples: Samples, spec: ReportSpec, confidence: float = 0.95
) -> Validation:
    """Return how measured parts compare with the samples that should predict them; ReportError as from `compare`."""
    if not spec.design.production or spec.proposal:
        raise ReportError(
            f"{spec.campaign}: its samples do not represent production as they are; take a plain campaign"
        )
    found = compare(parts, of_parts, samples, spec, confidence)
    predictions = tuple(_prediction(each, parts, samples, confidence) for each in found.responses)
    names = [each.response for each in found.responses if each.n >= _FEWEST and each.n_other >= _FEWEST]
    independent = parts.lots is None and samples.lots is None
    pairs = combinations(names, 2) if independent else ()
    correlations = [_correlation(pair, parts, samples, confidence) for pair in pairs]
    few = min((each.n_other for each in found.responses), default=0) < _FEWEST_FOR_TAILS
    notes = ["Measured values have the errors of their gauge, simulated ones have none."]
    if not independent:
        notes.append("Values in lots: no interval for shares and correlations.")
    if few:
        notes.append(f"Fewer than {_FEWEST_FOR_TAILS} simulated values: their tails are not compared.")
    return Validation(predictions, tuple(each for each in correlations if each is not None), tuple(notes))


def _prediction(of: ResponseComparison, parts: Samples, samples: Samples, confidence: float) -> Prediction:
    (measured, lots), (simulated, other_lots) = (values_of(each, of.response) for each in (parts, samples))
    if not measured.size or not simulated.size:
        return Prediction(of, (), 0.0, None, None, None, "there is nothing to compare")
    quantiles = zip(QUANTILES, np.quantile(measured, QUANTILES), np.quantile(simulated, QUANTILES), strict=True)
    low, high = np.quantile(simulated, (TAIL, 1 - TAIL))
    count = int(np.count_nonzero((measured < low) | (measured > high)))
    independent = lots is None and other_lots is None
    within = None if of.mean_interval is None else max(map(abs, of.mean_interval))
    ratio = of.std_ratio_interval
    factor = None if ratio is None else max(ratio[1], 1 / ratio[0])
    sharp = independent and simulated.size >= _FEWEST_FOR_TAILS
    beyond = share_interval(count, measured.size, confidence) if sharp else None
    return Prediction(
        of,
        tuple((p, float(x), float(y)) for p, x, y in quantiles),
        count / measured.size,
        beyond,
        within,
        factor,
        _verdict(of, within, factor, beyond),
    )


def _verdict(of: ResponseComparison, within: float | None, factor: float | None, beyond: Interval | None) -> str:
    """Return what the parts say of the prediction, and what they cannot tell."""
    if within is None or of.mean_interval is None or of.n < _FEWEST:
        return f"{of.n} parts are too few to judge the prediction"
    unit = "" if of.unit in ("", "1") else f" {of.unit}"
    low, high = of.mean_interval
    said = f"the model predicts the mean of these parts within {within:.3g}{unit}"
    said += "" if factor is None else f", sigma within a factor of {factor:.3g}"
    seen = []
    if low > 0 or high < 0:
        side = "above" if low > 0 else "below"
        seen.append(f"the mean is {side} the predicted one by {min(abs(low), abs(high)):.3g}{unit} or more")
    if of.std_ratio_interval is not None and not of.std_ratio_interval[0] <= 1 <= of.std_ratio_interval[1]:
        seen.append(f"sigma is {of.std_ratio:.3g} times the predicted one")
    if beyond is not None and beyond[0] > 4 * TAIL:
        seen.append("more parts lie in the tails than predicted")
    if seen:
        return f"{said}; seen: {', '.join(seen)}"
    return f"{said}; no difference is seen, one of the mean below {(high - low) / 2:.2g}{unit} could not be"


def _correlation(
    names: tuple[str, str], parts: Samples, samples: Samples, confidence: float
) -> PredictedCorrelation | None:
    """Return the correlations of two responses; None where one does not vary."""
    found = []
    for each in (parts, samples):
        x, y = (each.values[name] for name in names)
        rows = each.ok & np.isfinite(x) & np.isfinite(y)
        if rows.sum() < _FEWEST or not np.ptp(x[rows]) > 0 or not np.ptp(y[rows]) > 0:
            return None
        r = float(np.corrcoef(x[rows], y[rows])[0, 1])
        found.append((r, fisher_interval(r, float(rows.sum()), confidence)))
    (measured, ends), (simulated, other) = found
    between = of_difference((measured, simulated), (ends, other))
    assert between is not None
    return PredictedCorrelation(*names, measured, simulated, between)
