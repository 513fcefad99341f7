"""The one model of a report: from table and spec to frozen data; html and json only render it."""

import math
import shlex
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from reporting.capability import Capability, capability
from reporting.errors import ReportError
from reporting.histogram import Histogram, histogram
from reporting.intervals import share_lower_bound
from reporting.numbers import plain
from reporting.samples import OK, Samples, read_samples
from reporting.spec import ReportSpec, ResponseSpec, VariableSpec
from reporting.trust import Check, trust_checks
from reporting.worst_case import WorstCase, worst_case

if TYPE_CHECKING:
    import pyarrow

# From this Cpk on a response is capable, from the second on marginal.
CAPABLE, MARGINAL = 1.33, 1.00
CONFIDENCE = 0.95
FAILURES_LISTED = 20
WORST_CASE = "worst_case"  # the sampler of corners

STATUSES = {
    OK: "settled, every number is used",
    "not_converged": "a step missed the friction tolerance",
    "diverged": "a number was no longer finite",
    "timeout": "ran longer than allowed",
    "invalid": "settled, but broke a validity condition",
    "crashed": "the process or the code failed",
}


@dataclass(frozen=True)
class StatusCount:
    """How many samples ended with a status, and the first of them as example."""

    status: str
    meaning: str
    count: int
    share: float | None
    example: int | None
    message: str


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
        "capable", "marginal", "not capable", "no verdict" (limits, but no index) or "no limits".
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
        Over the corners, if the samples are those.
    """

    spec: ResponseSpec
    assumed: bool
    verdict: str
    certain: bool | None
    capability: Capability
    missing: int
    yield_: Yield | None
    histogram: Histogram | None
    worst: WorstCase | None = None


@dataclass(frozen=True)
class VariableAnalysis:
    """A sampled input: what was asked and what was drawn, over all samples, failed ones too."""

    spec: VariableSpec
    n: int
    mean: float | None
    std: float | None
    min: float | None
    max: float | None
    outside: int
    histogram: Histogram | None


@dataclass(frozen=True)
class FailedSample:
    """A sample without a result, and the command that repeats it."""

    sample: int
    status: str
    message: str
    command: str


@dataclass(frozen=True)
class Analysis:
    """Everything a report says."""

    spec: ReportSpec
    finished: int
    ok: int
    failed: int
    statuses: tuple[StatusCount, ...]
    trust: tuple[Check, ...]
    responses: tuple[ResponseAnalysis, ...]
    variables: tuple[VariableAnalysis, ...]
    failures: tuple[FailedSample, ...]
    confidence: float


def analyse(table: "pyarrow.Table", spec: ReportSpec) -> Analysis:
    """Return the analysis of a finished or running campaign.

    Parameters
    ----------
    table : pyarrow.Table
        One row per finished sample: number, variables, responses (used only where status is "ok"), status,
        message and the run's certificate.
    spec : ReportSpec
        What was asked.

    Raises
    ------
    ReportError
        The table does not fit the spec, or the limits of a response are crossed.
    """
    samples = read_samples(table, spec)
    responses = tuple(_response(response, samples, spec) for response in spec.responses)
    variables = tuple(_variable(variable, samples.values[variable.name]) for variable in spec.variables)
    ok = int(np.count_nonzero(samples.ok))
    return Analysis(
        spec=spec,
        finished=samples.sample.size,
        ok=ok,
        failed=samples.sample.size - ok,
        statuses=_statuses(samples),
        trust=trust_checks(spec, samples, responses, variables),
        responses=responses,
        variables=variables,
        failures=_failures(spec, samples),
        confidence=CONFIDENCE,
    )


def _response(spec: ResponseSpec, samples: Samples, asked: ReportSpec) -> ResponseAnalysis:
    """Analyse one response over the ok samples."""
    values = samples.values[spec.name][samples.ok]
    try:
        numbers = capability(values, spec.lsl, spec.usl, spec.target, CONFIDENCE)
    except ReportError as error:
        raise ReportError(f"response {spec.name}: {error}") from error
    worst = None
    if asked.sampler == WORST_CASE:
        inputs = {variable.name: samples.values[variable.name] for variable in asked.variables}
        everywhere = np.where(samples.ok, samples.values[spec.name], np.nan)
        worst = worst_case(everywhere, inputs, spec.lsl, spec.usl)
    word = verdict(numbers)
    certain = None
    if numbers.cpk_interval is not None:
        certain = all(_class(end) == word for end in numbers.cpk_interval)
    return ResponseAnalysis(
        spec=spec,
        assumed=spec.source.lower().startswith("assumption"),
        verdict=word,
        certain=certain,
        capability=numbers,
        missing=numbers.dropped,
        yield_=_yield(numbers, samples.sample.size),
        histogram=histogram(values[np.isfinite(values)], spec.lsl, spec.usl),
        worst=worst,
    )


def verdict(numbers: Capability) -> str:
    """Return the word for a capability: by Cpk, at 1.33 and 1.00."""
    if numbers.lsl is None and numbers.usl is None:
        return "no limits"
    return "no verdict" if numbers.cpk is None else _class(numbers.cpk)


def _class(cpk: float) -> str:
    """Return the class of a Cpk."""
    return "capable" if cpk >= CAPABLE else "marginal" if cpk >= MARGINAL else "not capable"


def _yield(numbers: Capability, finished: int) -> Yield | None:
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
        lower=share_lower_bound(conforming, finished, CONFIDENCE),
        cpk=cpk,
    )


def _variable(spec: VariableSpec, values: NDArray[np.float64]) -> VariableAnalysis:
    """Compare what was drawn with what was asked."""
    finite = values[np.isfinite(values)]
    low = -math.inf if spec.lower is None else spec.lower
    high = math.inf if spec.upper is None else spec.upper
    return VariableAnalysis(
        spec=spec,
        n=finite.size,
        mean=float(np.mean(finite)) if finite.size else None,
        std=float(np.std(finite, ddof=1)) if finite.size > 1 else None,
        min=float(finite.min()) if finite.size else None,
        max=float(finite.max()) if finite.size else None,
        outside=int(np.count_nonzero((finite < low) | (finite > high))) + values.size - finite.size,
        histogram=histogram(finite),
    )


def _statuses(samples: Samples) -> tuple[StatusCount, ...]:
    """Count every known status, zero too, and any other that the table holds."""
    counts = []
    for status in [*STATUSES, *sorted(set(samples.status.tolist()) - set(STATUSES))]:
        rows = np.flatnonzero(samples.status == status)
        named = status != OK and rows.size > 0
        counts.append(
            StatusCount(
                status=status,
                meaning=STATUSES.get(status, "a status this version does not know"),
                count=rows.size,
                share=rows.size / samples.sample.size if samples.sample.size else None,
                example=int(samples.sample[rows[0]]) if named else None,
                message=str(samples.message[rows[0]]) if named else "",
            )
        )
    return tuple(counts)


def _failures(spec: ReportSpec, samples: Samples) -> tuple[FailedSample, ...]:
    """List the first failed samples, each with the command that repeats it to the last bit of its inputs."""
    start = spec.simulate or f"clearcap simulate {shlex.quote(spec.provenance.get('mechanism', spec.campaign))}"
    return tuple(
        FailedSample(
            sample=int(samples.sample[row]),
            status=str(samples.status[row]),
            message=str(samples.message[row]),
            command=" ".join([start, *(_option(v, samples.values[v.name][row]) for v in spec.variables)]),
        )
        for row in np.flatnonzero(~samples.ok)[:FAILURES_LISTED]
    )


def _option(variable: VariableSpec, value: float) -> str:
    """Return the option that sets a variable, in full precision."""
    return f"--set {shlex.quote(f'{variable.key or variable.name}={plain(value)}')}"
