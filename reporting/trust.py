"""The trust card: whether the numbers of the report can be relied on.

Its lines check that the campaign is complete, that the simulation keeps its promises in every sample, and that the
statistics support the verdicts. Levels: "good", "attention" (read on before you sign), "bad" (do not sign), "info"
(nothing to judge).
"""

import math
from dataclasses import dataclass

import numpy as np

from reporting import format_numbers
from reporting.arrays import Array
from reporting.capability.convergence import DRIFT_BAR
from reporting.capability.intervals import cpk_half_width
from reporting.inputs import CorrelationAnalysis, VariableAnalysis
from reporting.response import ResponseAnalysis
from reporting.samples import OK, Samples
from reporting.spec import ReportSpec

# Promises for every ok row: relative residual of the friction problem; penetration, by unit.
RESIDUAL_BAR = 1e-6
PENETRATION_BAR = {"mm": 1e-6, "m": 1e-9}
OK_SHARE_BAR = 0.99
_NO_PRODUCTION = "The samples do not represent production."
_TOO_FEW = "Too few samples to compare their halves."
# Cpk to +-5 % is a usual requirement; at Cpk 1.33 it needs 874 samples.
WANTED_HALF_WIDTH = 0.05
# Chance does not put a drawn mean, sigma or correlation more standard errors away from the requested one.
INPUT_ERRORS_BAR = 4.0
# Chance does not give a distribution with a smaller p-value, even in many campaigns with many variables.
INPUT_P_BAR = 1e-5


@dataclass(frozen=True)
class Check:
    """One line of the trust card.

    Attributes
    ----------
    name : str
        What was checked.
    level : str
        "good", "attention", "bad" or "info".
    text : str
        The finding in words.
    value : float or None
        The number of the finding, if it has one.
    """

    name: str
    level: str
    text: str
    value: float | None = None


def trust_checks(
    spec: ReportSpec,
    samples: Samples,
    responses: tuple[ResponseAnalysis, ...],
    variables: tuple[VariableAnalysis, ...],
    correlations: tuple[CorrelationAnalysis, ...],
) -> tuple[Check, ...]:
    """Return the lines of the trust card, in reading order."""
    unit, design = samples.penetration_unit, spec.design
    return (
        Check("Sampling", "info" if design.production else "attention", design.text),
        _complete(spec.requested, samples),
        _enough(responses, production=design.production),
        _converged(responses, production=design.production),
        *([Check("Stopping rule", "info", spec.stop)] if spec.stop else []),
        _failed(samples),
        _rejects(responses, samples),
        _missing(responses),
        _shape(responses),
        _largest("Friction residual", samples, samples.max_residual, "", RESIDUAL_BAR),
        _largest("Penetration", samples, samples.max_penetration, unit, PENETRATION_BAR.get(unit)),
        _settled(samples),
        _inputs(variables, correlations, production=design.production),
    )


def _complete(requested: int, samples: Samples) -> Check:
    """Check that every requested sample is done."""
    done = samples.sample.size
    text = f"{format_numbers.grouped(done)} of {format_numbers.grouped(requested)} requested samples are computed."
    if done < requested:
        text += " The campaign is not finished: every number below is provisional."
    return Check("Complete", "good" if done == requested else "attention", text, float(done))


def _failed(samples: Samples) -> Check:
    """Check that few samples failed, and quote the most frequent failure."""
    done, ok = samples.sample.size, int(np.count_nonzero(samples.ok))
    if done == 0:
        return Check("Failures", "bad", "No sample is computed yet.")
    if ok == done:
        return Check("Failures", "good", "No sample failed.", 0.0)
    counts = {word: samples.rows_of(word).size for word in sorted(samples.statuses) if word != OK}
    worst = max(counts, key=counts.__getitem__)
    row = int(samples.rows_of(worst)[0])
    message = samples.messages.get(int(samples.sample[row]), "").strip() or "no message"
    text = (
        f"{format_numbers.grouped(done - ok)} of {format_numbers.grouped(done)} samples failed "
        f"({format_numbers.percent((done - ok) / done)}) and are left out of all statistics; most often {worst}, "
        f"first in sample {samples.sample[row]}: {message}"
    )
    level = "bad" if ok == 0 else "good" if ok / done >= OK_SHARE_BAR else "attention"
    return Check("Failures", level, text, float(done - ok))


def _largest(name: str, samples: Samples, values: Array, unit: str, bar: float | None) -> Check:
    """Check the largest value of a column of the certificate over the ok samples against its bound."""
    rows = np.flatnonzero(samples.ok)
    stated = rows[np.isfinite(values[rows])]
    if stated.size == 0:
        return Check(name, "info", f"No {OK} sample has this number.")
    row = int(stated[np.argmax(values[stated])])
    most, suffix = float(values[row]), f" {unit}" if unit else ""
    text = f"Largest over the ok samples: {format_numbers.significant(most, 2)}{suffix}, sample {samples.sample[row]}"
    if stated.size < rows.size:
        return Check(name, "bad", f"{text}; {rows.size - stated.size} ok samples lack it.", most)
    if bar is None:
        return Check(name, "info", f"{text}.", most)
    level = "good" if most <= bar else "bad"
    text += f"; {'within' if level == 'good' else 'over'} the bound of {format_numbers.plain(bar)}{suffix}."
    return Check(name, level, text, most)


def _settled(samples: Samples) -> Check:
    """Check that every ok sample came to rest."""
    total = int(np.count_nonzero(samples.ok))
    moving = total - int(np.count_nonzero(samples.settled & samples.ok))
    if total == 0:
        return Check("Settled", "info", "No ok sample.")
    if moving == 0:
        return Check("Settled", "good", "Every ok sample came to rest before its end.", 0.0)
    share = format_numbers.percent(moving / total)
    text = f"{format_numbers.grouped(moving)} ok samples ({share}) were still moving at their end."
    return Check("Settled", "attention", text, float(moving))


def _missing(responses: tuple[ResponseAnalysis, ...]) -> Check:
    """Check that every ok sample has a number for every response."""
    incomplete = [(r.spec.name, r.missing) for r in responses if r.missing]
    if not incomplete:
        return Check("Values", "good", "Every ok sample has a finite number for every response.", 0.0)
    listed = ", ".join(f"{name} {format_numbers.grouped(count)}" for name, count in incomplete)
    text = f"Ok samples without a finite number, left out of the statistics and counted as rejects: {listed}."
    return Check("Values", "bad", text, float(sum(count for _, count in incomplete)))


def _enough(responses: tuple[ResponseAnalysis, ...], *, production: bool) -> Check:
    """Check that the intervals of Cpk are narrow enough for the verdicts."""
    indexed = [(r, r.capability) for r in responses if r.capability.cpk is not None]
    if not indexed or not production:
        reason = _NO_PRODUCTION if indexed else "No response has a Cpk."
        return Check("Enough samples", "info", reason)
    # A width relative to a Cpk near 0 is meaningless: below 1 it is relative to 1.
    widths = [cpk_half_width(c.cpk or 0.0, c.n, c.confidence) / max(abs(c.cpk or 0.0), 1.0) for _, c in indexed]
    at = widths.index(max(widths))
    response, c = indexed[at]
    text = f"Cpk is known to ±{format_numbers.percent(widths[at])} or better (widest: {response.spec.name})"
    if widths[at] > WANTED_HALF_WIDTH:
        needed = math.ceil(c.n * (widths[at] / WANTED_HALF_WIDTH) ** 2)
        text += f"; about {format_numbers.grouped(round(needed, 2 - len(str(needed))))} samples would give ±5 %"
    uncertain = [r.spec.name for r, _ in indexed if not r.certain]
    if uncertain:
        text += f". The interval of {', '.join(uncertain)} includes another verdict: more samples are needed to decide"
    return Check("Enough samples", "attention" if uncertain else "good", f"{text}.", widths[at])


def _converged(responses: tuple[ResponseAnalysis, ...], *, production: bool) -> Check:
    """Check that the first and the second half of the samples agree."""
    drifts = {r.spec.name: abs(r.running.drift) for r in responses if r.running and r.running.drift is not None}
    if not drifts or not production:
        return Check("Converged", "info", _TOO_FEW if production else _NO_PRODUCTION)
    name = max(drifts, key=drifts.__getitem__)
    errors = format_numbers.fixed(drifts[name], 1, (DRIFT_BAR,))
    text = f"First and second half of the samples differ by at most {errors} standard errors of an index ({name})"
    if drifts[name] <= DRIFT_BAR:
        return Check("Converged", "good", f"{text}, which chance explains.", drifts[name])
    return Check(
        "Converged",
        "attention",
        f"{text}, more than chance explains: something changed during the campaign.",
        drifts[name],
    )


def _rejects(responses: tuple[ResponseAnalysis, ...], samples: Samples) -> Check:
    """Report Cpk with every failure counted as a reject."""
    name = "Failures as rejects"
    if samples.ok.all():
        return Check(name, "good" if samples.ok.size else "info", "No sample failed, so Cpk is the same.")
    indices = [(r.yield_.cpk, r.spec.name) for r in responses if r.yield_ and r.yield_.cpk is not None]
    if not indices:
        return Check(name, "info", "No response has a Cpk.")
    lowest = ", ".join(f"{response} {format_numbers.index(cpk)}" for cpk, response in sorted(indices)[:3])
    return Check(name, "info", f"Cpk if every failed sample were a reject on the worse side, lowest first: {lowest}.")


def _shape(responses: tuple[ResponseAnalysis, ...]) -> Check:
    """Check that the responses are close to normal, by the size of the departure."""
    shaped = [r for r in responses if r.capability.cpk is not None and r.normality.distance is not None]
    if not shaped:
        return Check("Shape", "info", "No response with limits has values enough to judge its shape.")
    other = [r.spec.name for r in shaped if r.normality.verdict == "not normal"]
    undecided = [r.spec.name for r in shaped if r.normality.verdict in ("undecided", "too few values")]
    if other:
        text = (
            f"Not normal: {', '.join(other)}. For these read the non-normal methods instead of Cpk and the normal ppm."
        )
        return Check("Shape", "attention", text, float(len(other)))
    if undecided:
        text = f"Too few samples to tell whether {', '.join(undecided)} is normal; no departure is proven."
        return Check("Shape", "info", text, 0.0)
    return Check(
        "Shape", "good", "Every response with limits is normal, or close enough to normal for these numbers.", 0.0
    )


def _inputs(
    variables: tuple[VariableAnalysis, ...], correlations: tuple[CorrelationAnalysis, ...], *, production: bool
) -> Check:
    """Check mean, sigma, bounds, distribution and correlations of the drawn variables against the request."""
    name = "Inputs as requested"
    if not variables:
        return Check(name, "info", "The campaign has no variable.")
    outside = sum(v.outside for v in variables)
    if outside:
        text = f"{format_numbers.grouped(outside)} drawn values are outside the requested bounds or missing."
        return Check(name, "bad", text, float(outside))
    moments = [(v.spec.name, (("mean", v.mean_errors), ("sigma", v.std_errors))) for v in variables]
    errors = {f"{word} of {v}": e for v, pairs in moments for word, e in pairs if e is not None}
    errors |= {f"correlation of {c.first} and {c.second}": abs(c.errors) for c in correlations}
    if not errors or not production:
        reason = (
            "there are too few samples"
            if production
            else "the samples do not represent production, so there is no reason"
        )
        return Check(
            name, "info", f"All values are within their bounds; {reason} to compare the distributions with the request."
        )
    worst = max(errors, key=errors.__getitem__)
    different = [v.spec.name for v in variables if v.p_value is not None and v.p_value < INPUT_P_BAR]
    distance = format_numbers.fixed(errors[worst], 1, (INPUT_ERRORS_BAR,))
    text = (
        f"Means, sigmas and correlations are within {distance} standard errors of the request (largest: {worst}); "
        "no value is outside its bounds."
    )
    if different:
        text += f" The distribution of {', '.join(different)} is not the requested one (Kolmogorov)."
    return Check(name, "attention" if different or errors[worst] > INPUT_ERRORS_BAR else "good", text, errors[worst])
