"""Measured parts beside the simulated ones that should predict them: how far the prediction is off, at most.

Differences, ratios and their intervals are those of `reporting.comparison`. A difference that is not significant proves
no agreement: the end of its interval that is farther from none is what the model is certain to predict within.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from reporting.capability.intervals import Interval, share_interval
from reporting.comparison import ResponseComparison, compare, of_difference, values_of
from reporting.errors import ReportError
from reporting.response_correlations import fisher_interval
from reporting.samples import Samples
from reporting.spec import ReportSpec

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
    """Return how well one response is predicted."""
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
