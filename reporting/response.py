"""One response: what was asked, what came out, what it rests on, the verdict."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from reporting.arrays import Array
from reporting.capability.convergence import Convergence, convergence
from reporting.capability.intervals import share_lower_bound
from reporting.capability.shares import Nonconforming, nonconforming, runs_to_claim
from reporting.capability.summary import Capability, capability
from reporting.capability.verdict import class_of, verdict
from reporting.errors import ReportError
from reporting.samples import Samples
from reporting.sensitivity.influence import ResponseSensitivity
from reporting.shape.fits import Fits, fit_families
from reporting.shape.histogram import Histogram, histogram
from reporting.shape.nonnormal import NonnormalIndices, empirical_indices, fitted_indices
from reporting.shape.normality import CLOSE, Normality, ProbabilityPlot, normality, probability_plot
from reporting.shape.tails import TailShare, pareto_tails
from reporting.spec import ReportSpec, ResponseSpec
from reporting.tolerance.worst_case import WorstCase, worst_case

# The share of a centred normal response with Cp 1.33: what "1.33" claims.
CLAIM_PPM = 64.0
# Families fitted first; the others cost three times as much and are asked only where none of these is close.
QUICK = ("normal", "lognormal", "weibull", "gamma", "logistic", "largest_extreme", "smallest_extreme", "box_cox")
_FEWEST_FOR_A_FIT = 20


@dataclass(frozen=True)
class Yield:
    """A response's count over all finished samples, failures as rejects.

    Attributes
    ----------
    finished, conforming : int
        Samples done, and those of them that ran ok and lie within the limits.
    share, lower : float
        Conforming share and its one-sided Clopper-Pearson lower bound.
    cpk : float or None
        ``-Phi^-1(f + (1 - f) Phi(-3 Cpk)) / 3`` with f the failed share: Cpk if every failure fell on the
        worse side. Equal to Cpk where nothing failed.
    """

    finished: int
    conforming: int
    share: float
    lower: float
    cpk: float | None


@dataclass(frozen=True)
class ResponseAnalysis:
    """A response: what was asked, what came out, the verdict.

    Attributes
    ----------
    spec : ResponseSpec
    assumed : bool
        The limits are an assumption, says their source.
    verdict : str
        "capable", "marginal", "not capable", "no verdict" (limits, but no index, or no production) or "no limits".
    certain : bool or None
        Both ends of Cpk's interval have the same verdict; None without an interval.
    capability : Capability
        Over the ok samples.
    missing : int
        Ok samples whose value is not a finite number.
    yield_ : Yield or None
        None without limits or without a finished sample.
    histogram : Histogram or None
        None without values.
    worst : WorstCase or None
        Over the corners, if the samples are those, or the campaign compared with has them.
    nonconforming : Nonconforming or None
        Counted shares; None without limits or values.
    claim_runs : int or None
        Runs in which as many rejects as here would prove at most 64 ppm, the share Cpk 1.33 stands for.
    tails : tuple of TailShare
        Share beyond each limit from a Pareto tail.
    normality : Normality
    plot : ProbabilityPlot or None
    fits : Fits
        Distributions fitted.
    methods : tuple of NonnormalIndices
        By percentiles and by Z-scores of the best fit, and by the values' own percentiles.
    running : Convergence or None
        How the index settled.
    sensitivity : ResponseSensitivity or None
        What moves it.
    """

    spec: ResponseSpec
    assumed: bool
    verdict: str
    certain: bool | None
    capability: Capability
    missing: int
    yield_: Yield | None
    histogram: Histogram | None
    worst: WorstCase | None
    nonconforming: Nonconforming | None
    claim_runs: int | None
    tails: tuple[TailShare, ...]
    normality: Normality
    plot: ProbabilityPlot | None
    fits: Fits
    methods: tuple[NonnormalIndices, ...]
    running: Convergence | None
    sensitivity: ResponseSensitivity | None


def analyse_response(
    spec: ResponseSpec,
    samples: Samples,
    asked: ReportSpec,
    sensitivity: ResponseSensitivity | None,
    corners: tuple[Samples, ReportSpec] | None,
    confidence: float,
) -> ResponseAnalysis:
    """Analyse one response over the ok samples, and its worst case over a campaign of corners if there is one.

    Raises
    ------
    ReportError
        Its limits are crossed.
    """
    values = samples.values[spec.name][samples.ok]
    batches = None if samples.production_batch is None else samples.production_batch[samples.ok]
    try:
        numbers = capability(values, spec.lsl, spec.usl, spec.target, confidence, batches)
    except ReportError as error:
        raise ReportError(f"response {spec.name}: {error}") from error
    x = values[np.isfinite(values)]
    word = verdict(numbers)
    certain = None
    if numbers.cpk_interval is not None:
        certain = all(class_of(end) == word for end in numbers.cpk_interval)
    if word != "no limits" and not asked.design.production:
        word, certain = "no verdict", None
    counted = nonconforming(x, spec.lsl, spec.usl, confidence, samples.sample.size - x.size)
    shape = normality(x, confidence)
    limited = spec.lsl is not None or spec.usl is not None
    fits = _fits(x, shape, limited=limited)
    return ResponseAnalysis(
        spec=spec,
        assumed=spec.source.lower().startswith("assumption"),
        verdict=word,
        certain=certain,
        capability=numbers,
        missing=numbers.dropped,
        yield_=_yield(numbers, samples.sample.size, confidence),
        histogram=histogram(x, spec.lsl, spec.usl),
        worst=None if corners is None else _corners(spec, *corners),
        nonconforming=counted,
        claim_runs=None if counted is None else runs_to_claim(CLAIM_PPM, confidence, counted.total.count),
        tails=pareto_tails(x, spec.lsl, spec.usl, confidence) if limited else (),
        normality=shape,
        plot=probability_plot(x, confidence=confidence),
        fits=fits,
        methods=_methods(x, fits, spec, confidence) if limited else (),
        running=convergence(x, spec.lsl, spec.usl, confidence),
        sensitivity=sensitivity,
    )


def _corners(spec: ResponseSpec, samples: Samples, asked: ReportSpec) -> WorstCase | None:
    """Return the worst case over the corners; None if they know no such response."""
    if spec.name not in samples.values:
        return None
    inputs = {variable.name: samples.values[variable.name] for variable in asked.variables}
    everywhere = np.where(samples.ok, samples.values[spec.name], np.nan)
    return worst_case(everywhere, inputs, spec.lsl, spec.usl)


def _fits(x: Array, shape: Normality, *, limited: bool) -> Fits:
    """Return the fitted distributions; all families only where no usual one is close and a verdict hangs on it."""
    if x.size < _FEWEST_FOR_A_FIT:
        return Fits((), None, {}, (f"{x.size} values: no distribution is fitted below {_FEWEST_FOR_A_FIT}.",))
    few = fit_families(x, names=QUICK)
    best = few.of(few.best)
    # The distance of a right fit is up to 1 / sqrt(n) by chance.
    close = max(CLOSE / 2, 1 / math.sqrt(x.size))
    if (
        not limited
        or best is None
        or (best.distance <= close and (best.family != "normal" or shape.verdict != "not normal"))
    ):
        return few
    return fit_families(x)


def _methods(x: Array, fits: Fits, spec: ResponseSpec, confidence: float) -> tuple[NonnormalIndices, ...]:
    """Return the indices that do not rest on the normal distribution."""
    best = fits.of(fits.best)
    empirical = empirical_indices(x, spec.lsl, spec.usl, confidence)
    if best is None:
        return (empirical,)
    fitted = [fitted_indices(method, best, spec.lsl, spec.usl, confidence) for method in ("percentile", "z_score")]
    return (*fitted, empirical)


def _yield(numbers: Capability, finished: int, confidence: float) -> Yield | None:
    """Count failures, and values that are missing, as rejects."""
    if finished == 0 or (numbers.lsl is None and numbers.usl is None):
        return None
    conforming = numbers.n - (numbers.below or 0) - (numbers.above or 0)
    failed = (finished - numbers.n) / finished
    cpk = numbers.cpk
    if cpk is not None and failed > 0:
        cpk = -float(ndtri(failed + (1 - failed) * float(ndtr(-3 * cpk)))) / 3
    return Yield(
        finished=finished,
        conforming=conforming,
        share=conforming / finished,
        lower=share_lower_bound(conforming, finished, confidence),
        cpk=cpk,
    )
