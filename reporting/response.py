"""One response: its limits, its numbers and the verdict."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from reporting.arrays import Array, Columns
from reporting.capability.intervals import Estimate, share_lower_bound
from reporting.capability.row_order import ControlChart, Convergence, control_chart, convergence
from reporting.capability.shares import Nonconforming, Share, nonconforming, runs_to_claim
from reporting.capability.summary import (
    Capability,
    Historical,
    TargetIndices,
    capability_and_values,
    historical,
    target_indices,
)
from reporting.capability.verdict import CapabilityVerdict, bars_of, verdict
from reporting.capability.within import SubgroupSigma, subgroup_sigmas
from reporting.errors import ReportError
from reporting.gauge import BehindGauge, Conformity, behind_gauge, conformity
from reporting.samples import Samples, why_no_value
from reporting.sensitivity.influence import ResponseSensitivity
from reporting.sensitivity.repeatability import Repeatability
from reporting.sensitivity.scatter import Scatter, scatters
from reporting.shape.estimates import (
    ExpectedShare,
    expected_share,
    index_estimates,
    second_population,
    without_intervals,
)
from reporting.shape.fitting import Fits, fit_families, unfitted
from reporting.shape.histogram import Histogram, histogram
from reporting.shape.nonnormal import NonnormalIndices, empirical_indices
from reporting.shape.normality import PROVEN_P, Normality, ProbabilityPlot, departs, normality, probability_plot
from reporting.shape.pareto import TailShare, pareto_tails
from reporting.shape.sorted_sample import SortedSample
from reporting.shape.supported_indices import supported_indices
from reporting.shape.time_model import TimeModel, time_model
from reporting.spec import ReportSpec, ResponseSpec
from reporting.tolerance.stack_up import LinearStack, WorstCase, linear_stack, worst_case
from reporting.tolerance_intervals import ToleranceIntervals, tolerance_intervals

# Share out of limits of a centred normal response with Cp 1.33.
CLAIM_PPM = 64.0
_FEWEST_FOR_A_FIT = 20


@dataclass(frozen=True)
class Yield:
    """The yield of a response over all finished samples, with failures counted as rejects."""

    finished: int  # samples
    conforming: int  # ok samples within the limits
    share: float  # conforming
    lower: float  # one-sided Clopper-Pearson bound of `share`
    # As if every failure lay beyond the nearer limit: ``-Phi^-1(f + (1 - f) Phi(-3 Cpk)) / 3`` with the failed share f.
    # Equal to Cpk without failures.
    cpk: float | None


@dataclass(frozen=True)
class ResponseAnalysis:
    """All numbers of a response."""

    spec: ResponseSpec
    assumed: bool  # whether the source of the limits calls them an assumption
    verdict: CapabilityVerdict
    capability: Capability  # of the ok samples
    target_indices: TargetIndices | None  # Cpm* and Cpmk; None without a target between the limits
    historical: Historical | None  # with the mean and sigma of the process so far; None where these are not given
    # sigma within production batches from ranges and from sigmas; empty without batches
    subgroups: tuple[SubgroupSigma, ...]
    missing: int  # ok samples whose value is not finite
    yield_: Yield | None  # None without limits or without a finished sample
    histogram: Histogram | None  # None without values, or if all are equal
    worst: WorstCase | None  # of the corners of this campaign or of the one it is compared with; None without corners
    stack: LinearStack | None  # worst case and RSS from slopes; None if the samples are not production or too few
    nonconforming: Nonconforming | None  # counted shares; None without limits or values
    expected: ExpectedShare | None  # share out of limits: by the normal distribution, or without it if not normal
    claim_runs: int | None  # that would prove at most 64 ppm, the share of Cpk 1.33, with as many rejects as here
    tails: tuple[TailShare, ...]  # share beyond each limit, from a fitted Pareto tail
    normality: Normality
    plot: ProbabilityPlot | None
    fits: Fits
    # from percentiles and Z-scores of the best fit, and from percentiles of the values
    methods: tuple[NonnormalIndices, ...]
    tolerance_intervals: ToleranceIntervals | None  # None if the samples are not production
    running: Convergence | None  # how the index converges
    sensitivity: ResponseSensitivity | None  # influence of the variables on the response
    scatters: tuple[Scatter, ...]  # plots of the response against its strongest inputs
    repeatability: Repeatability | None = None  # between runs of a sample with different steps; None without repeats
    gauge: BehindGauge | None = None  # the process without the errors of its gauge; None where these are not stated
    conformity: Conformity | None = None  # what the measurements prove of the parts; None without an uncertainty
    chart: ControlChart | None = None  # values in order; None if the samples are not production, or too few
    time_model: TimeModel | None = None  # of measured parts in a known order
    rounding: float | None = None  # largest difference between values that are treated as one, as it is rounding only

    @property
    def index(self) -> float | None:
        """The index that decides the verdict, infinite where no share lies out of limits; without a verdict, Cpk."""
        if self.verdict.by and self.verdict.index is None and self.verdict.index_low is not None:
            return math.inf
        return self.capability.cpk if self.verdict.index is None else self.verdict.index


def analyse_response(
    spec: ResponseSpec,
    samples: Samples,
    request: ReportSpec,
    sensitivity: ResponseSensitivity | None,
    corners: tuple[Samples, ReportSpec] | None,
    confidence: float,
    further: tuple[Estimate, ...] = (),
    withheld: str = "",
) -> ResponseAnalysis:
    """Analyse one response over the ok samples, and over the corners; `further` estimates come from other samples."""
    values = samples.values[spec.name][samples.ok]
    inputs = samples.of_ok.only(v.name for v in request.variables)
    batches = None if samples.production_batch is None else samples.production_batch[samples.ok]
    lots = None if samples.lots is None else samples.lots[samples.ok]
    try:
        numbers, given = capability_and_values(
            values, spec.lsl, spec.usl, spec.target, confidence, batches, lots, ordered=request.ordered
        )
    except ReportError as error:
        raise ReportError(f"response {spec.name}: {error}") from error
    finite = np.isfinite(values)
    x, lots = given.x, None if lots is None else lots[finite]
    # An ok sample without a finite value may be a reject just as a failed one.
    counted = nonconforming(x, spec.lsl, spec.usl, confidence, samples.sample.size - x.size, lots)
    assert given.ordered is not None
    ordered = SortedSample(given.ordered, given.location)
    shape = normality(ordered, confidence, None if numbers.lots is None else numbers.lots.effective)
    limited = spec.lsl is not None or spec.usl is not None
    fits = _fits(ordered, spec)
    methods = _methods(ordered, fits, spec, confidence) if limited else ()
    tails = pareto_tails(ordered, spec.lsl, spec.usl, confidence) if limited else ()
    # The intervals of these methods assume independent values.
    if numbers.lots is not None:
        methods, tails = without_intervals(methods, tails)
    with_failures = yield_with_failures(numbers, counted, samples.sample.size, confidence)
    # What chance alone makes look not normal among several responses must not change which estimate decides.
    tested = sum(r.lsl is not None or r.usl is not None for r in request.responses)
    normal = not departs(shape, tested, PROVEN_P)
    worth = x.size if numbers.lots is None else numbers.lots.effective
    unseen = second_population(x, spec.lsl, spec.usl, worth) if limited and x.size else None
    if unseen is not None and unseen.ppm and numbers.lots is None:
        # Said of every sample, because those that have no value of a second population need it most.
        fits = replace(fits, notes=(*fits.notes, f"{unseen.words}."))
    others = (*index_estimates(numbers.n, fits, methods, tails), *further)
    return ResponseAnalysis(
        spec=spec,
        assumed=spec.source.lower().startswith("assumption"),
        verdict=verdict(
            numbers,
            counted,
            others,
            production=request.design.production,
            normal=normal,
            withheld=withheld or why_no_value(samples, numbers.n, request.min_ok),
            bars=bars_of(spec.requirement, spec.index),
            unseen=unseen,
        ),
        capability=numbers,
        target_indices=target_indices(given, spec.lsl, spec.usl, spec.target, confidence, lots),
        historical=None if spec.historical is None else historical(numbers, *spec.historical),
        subgroups=() if batches is None else subgroup_sigmas(x, batches[finite], spec.lsl, spec.usl),
        missing=numbers.dropped,
        yield_=with_failures,
        histogram=None if numbers.std == 0 else histogram(ordered, spec.lsl, spec.usl),
        worst=None if corners is None else _corners(spec, *corners),
        stack=_stack(values, ordered, inputs, spec, request),
        nonconforming=counted,
        expected=expected_share(numbers, fits, methods, tails, normal=normal),
        claim_runs=None if counted is None else _runs_to_claim(counted.total, confidence),
        tails=tails,
        normality=shape,
        plot=probability_plot(ordered, confidence=confidence),
        fits=fits,
        methods=methods,
        tolerance_intervals=tolerance_intervals(x, shape, fits, confidence, lots, ordered)
        if request.design.production
        else None,
        gauge=None if spec.gauge_sigma is None else _behind_gauge(x, spec, normal, numbers, confidence),
        conformity=None if spec.uncertainty is None else conformity(x, spec.lsl, spec.usl, spec.uncertainty),
        chart=_chart(x, lots, samples, finite, request),
        time_model=_time_model(x, lots, samples, finite, request),
        running=convergence(x, spec.lsl, spec.usl, confidence, lots),
        sensitivity=sensitivity,
        scatters=() if numbers.std == 0 else scatters(sensitivity, inputs, values),
    )


def _behind_gauge(
    x: Array, spec: ResponseSpec, normal: bool, numbers: Capability, confidence: float
) -> BehindGauge | None:
    """Return the process behind its gauge; without an interval where values are not normal or come in lots."""
    doubt = "" if normal else "The values are not normal, so the index behind the gauge has no interval."
    if numbers.lots is not None:
        doubt = "The values come in lots, so the index behind the gauge has no interval."
    sigma = spec.gauge_sigma or 0.0
    return behind_gauge(x, spec.lsl, spec.usl, sigma, spec.gauge_freedom, confidence, doubt)


def _chart(
    x: Array, lots: NDArray[np.int64] | None, samples: Samples, finite: NDArray[np.bool_], request: ReportSpec
) -> ControlChart | None:
    """Return the control chart; only measured parts have subgroups, chosen tests and a chart of their spread."""
    if not request.design.production:
        return None
    if not request.measured:
        return control_chart(x, lots)
    groups = None if samples.subgroup is None else samples.subgroup[samples.ok][finite]
    return control_chart(x, lots, request.charts, groups)


def _time_model(
    x: Array, lots: NDArray[np.int64] | None, samples: Samples, finite: NDArray[np.bool_], request: ReportSpec
) -> TimeModel | None:
    """Return the model class of measured values; None for samples, and where parts are in no order."""
    if not request.measured or not request.ordered:
        return None
    if samples.subgroup is not None:
        return time_model(x, samples.subgroup[samples.ok][finite], "subgroups")
    return time_model(x, lots, "lots" if lots is not None else "")


def yield_with_failures(
    numbers: Capability, counted: Nonconforming | None, finished: int, confidence: float
) -> Yield | None:
    """Return the yield, with failures and missing values counted as rejects; None without limits or samples."""
    if finished == 0 or (numbers.lsl is None and numbers.usl is None):
        return None
    conforming = numbers.n - (numbers.below or 0) - (numbers.above or 0)
    failed = (finished - numbers.n) / finished
    effect = 1.0 if counted is None else finished / counted.with_failures.worth  # above 1 with production lots
    cpk = numbers.cpk
    if cpk is not None and failed > 0:
        cpk = -float(ndtri(failed + (1 - failed) * float(ndtr(-3 * cpk)))) / 3
    return Yield(
        finished=finished,
        conforming=conforming,
        share=conforming / finished,
        lower=share_lower_bound(conforming / effect, finished / effect, confidence),
        cpk=cpk,
    )


def _corners(spec: ResponseSpec, samples: Samples, request: ReportSpec) -> WorstCase | None:
    """Return the worst case over the corners; None if they do not have the response."""
    if spec.name not in samples.values:
        return None
    inputs = {variable.name: samples.values[variable.name] for variable in request.variables}
    # A failed corner may be the worst one: it is passed on as missing instead of being left out.
    everywhere = np.where(samples.ok, samples.values[spec.name], np.nan)
    return worst_case(everywhere, inputs, spec.lsl, spec.usl)


def _stack(
    y: Array, ordered: SortedSample, inputs: Columns, spec: ResponseSpec, request: ReportSpec
) -> LinearStack | None:
    """Return worst case and root sum of squares from slopes; None if the samples are not production or too few."""
    if not request.design.production:
        return None
    limits, correlated = (spec.lsl, spec.usl), bool(request.correlations)
    return linear_stack(
        y, inputs, request.variables, limits, correlated=correlated, command=request.command, ordered=ordered
    )


def _fits(x: SortedSample, spec: ResponseSpec) -> Fits:
    if x.values.size < _FEWEST_FOR_A_FIT:
        return unfitted(f"{x.values.size} values are too few to fit a distribution: {_FEWEST_FOR_A_FIT} are needed.")
    return fit_families(x, limits=(spec.lsl, spec.usl))


def _methods(x: SortedSample, fits: Fits, spec: ResponseSpec, confidence: float) -> tuple[NonnormalIndices, ...]:
    fitted = supported_indices(x, fits, spec.lsl, spec.usl, confidence)
    return (*fitted, empirical_indices(x, spec.lsl, spec.usl, confidence))


def _runs_to_claim(total: Share, confidence: float) -> int:
    """Return the number of runs that would prove the share of Cpk 1.33; with production lots a run proves less."""
    return math.ceil(runs_to_claim(CLAIM_PPM, confidence, total.count) * total.n / total.worth)
