"""The trust card, part two: do the statistics carry the verdicts; and the whole card in reading order."""

import math
from typing import TYPE_CHECKING

from reporting.capability.convergence import DRIFT_BAR
from reporting.capability.intervals import cpk_half_width
from reporting.designs import design
from reporting.render import format_numbers as numbers
from reporting.samples import Samples
from reporting.spec import ReportSpec
from reporting.trust import PENETRATION_BAR, RESIDUAL_BAR, Check, complete, failed, largest, missing, settled

if TYPE_CHECKING:
    from reporting.inputs import CorrelationAnalysis, VariableAnalysis
    from reporting.response import ResponseAnalysis

# Cpk known to +-5 %: the usual wish; at Cpk 1.33 it takes 874 samples.
WANTED_HALF_WIDTH = 0.05
# A drawn mean, sigma or correlation this many standard errors off the requested one does not happen by chance.
INPUT_ERRORS_BAR = 4.0
# Nor does a distribution as far off as happens once in so many campaigns and variables.
INPUT_P_BAR = 1e-5


def trust_checks(
    spec: ReportSpec,
    samples: Samples,
    responses: "tuple[ResponseAnalysis, ...]",
    variables: "tuple[VariableAnalysis, ...]",
    correlations: "tuple[CorrelationAnalysis, ...]",
) -> tuple[Check, ...]:
    """Return the lines of the trust card, in reading order."""
    unit, found = samples.penetration_unit, design(spec.sampler)
    return (
        Check("Sampling", "info" if found.production else "attention", found.text),
        complete(spec.requested, samples),
        _enough(responses, production=found.production),
        _converged(responses, production=found.production),
        *([Check("Stopping rule", "info", spec.stop)] if spec.stop else []),
        failed(samples),
        _rejects(responses, samples),
        missing(responses),
        _shape(responses),
        largest("Friction residual", samples, samples.max_residual, "", RESIDUAL_BAR),
        largest("Penetration", samples, samples.max_penetration, unit, PENETRATION_BAR.get(unit)),
        settled(samples),
        _inputs(variables, correlations, production=found.production),
    )


def _enough(responses: "tuple[ResponseAnalysis, ...]", *, production: bool) -> Check:
    """Check that Cpk is known well enough to stand by every verdict."""
    known = [(r, r.capability) for r in responses if r.capability.cpk is not None]
    if not known or not production:
        return Check("Enough samples", "info", "No response has a Cpk." if not known else "Not asked of no production.")
    # Near Cpk 0 a relative width means nothing: below 1 the width is taken relative to 1.
    widths = [cpk_half_width(c.cpk or 0.0, c.n, c.confidence) / max(abs(c.cpk or 0.0), 1.0) for _, c in known]
    at = widths.index(max(widths))
    response, c = known[at]
    text = f"Cpk is known to ±{numbers.percent(widths[at])} or better (widest: {response.spec.name})"
    if widths[at] > WANTED_HALF_WIDTH:
        needed = math.ceil(c.n * (widths[at] / WANTED_HALF_WIDTH) ** 2)
        text += f"; about {numbers.grouped(round(needed, 2 - len(str(needed))))} samples would make it ±5 %"
    unsure = [r.spec.name for r, _ in known if not r.certain]
    if unsure:
        text += f". The interval reaches another verdict for {', '.join(unsure)}: it takes more samples to decide"
    return Check("Enough samples", "attention" if unsure else "good", f"{text}.", widths[at])


def _converged(responses: "tuple[ResponseAnalysis, ...]", *, production: bool) -> Check:
    """Check that the first and the second half of the samples tell the same."""
    drifts = {r.spec.name: abs(r.running.drift) for r in responses if r.running and r.running.drift is not None}
    if not drifts or not production:
        return Check("Converged", "info", "Too few samples to compare their halves." if production else "Not asked.")
    name = max(drifts, key=drifts.__getitem__)
    errors = numbers.fixed(drifts[name], 1, (DRIFT_BAR,))
    text = f"First and second half of the samples differ by {errors} standard errors of an index at most ({name})"
    if drifts[name] <= DRIFT_BAR:
        return Check("Converged", "good", f"{text}: chance explains it.", drifts[name])
    return Check("Converged", "attention", f"{text}: more than chance; something changed on the way.", drifts[name])


def _rejects(responses: "tuple[ResponseAnalysis, ...]", samples: Samples) -> Check:
    """Say what the verdicts would be if every failure were a reject."""
    name = "Failures as rejects"
    if samples.ok.all():
        return Check(name, "good" if samples.ok.size else "info", "Nothing failed, so nothing changes.")
    worse = []
    for r in responses:
        counted = r.yield_.cpk if r.yield_ else None
        if counted is not None:
            worse.append((counted, f"{r.spec.name} {numbers.index(counted)}"))
    if not worse:
        return Check(name, "info", "No response has a Cpk.")
    lowest = ", ".join(text for _, text in sorted(worse)[:3])
    return Check(name, "info", f"Cpk if every failed sample were a reject on the worse side, lowest first: {lowest}.")


def _shape(responses: "tuple[ResponseAnalysis, ...]") -> Check:
    """Check by effect size that normal is a fair guess: at 30,000 samples every test rejects it."""
    known = [r for r in responses if r.capability.cpk is not None and r.normality.distance is not None]
    if not known:
        return Check("Shape", "info", "No response with limits has a shape.")
    odd = [r.spec.name for r in known if r.normality.verdict == "not normal"]
    open_ = [r.spec.name for r in known if r.normality.verdict in ("undecided", "too few values")]
    if odd:
        text = (
            f"Not normal: {', '.join(odd)}. Read the non-normal methods there, not Cpk and the expected ppm of a "
            "normal distribution."
        )
        return Check("Shape", "attention", text, float(len(odd)))
    if open_:
        text = f"Too few samples to tell whether {', '.join(open_)} would be normal; no departure is proven."
        return Check("Shape", "info", text, 0.0)
    return Check("Shape", "good", "Every response with limits is normal, or close enough for these numbers.", 0.0)


def _inputs(
    variables: "tuple[VariableAnalysis, ...]", correlations: "tuple[CorrelationAnalysis, ...]", *, production: bool
) -> Check:
    """Check that the drawn inputs have the requested mean, sigma, bounds, distribution and correlations."""
    name = "Inputs as asked"
    if not variables:
        return Check(name, "info", "No variable.")
    outside = sum(v.outside for v in variables)
    if outside:
        text = f"{numbers.grouped(outside)} drawn values are outside the requested bounds or missing."
        return Check(name, "bad", text, float(outside))
    errors = {f"{word} of {v.spec.name}": e for v in variables for word, e in _moments(v) if e is not None}
    errors |= {f"correlation of {c.first} and {c.second}": abs(c.errors) for c in correlations}
    if not errors or not production:
        return Check(name, "info", "Within their bounds; " + ("too few samples" if production else "no reason") + " to"
                     " compare the distributions with what was asked.")  # fmt: skip
    worst = max(errors, key=errors.__getitem__)
    off = [v.spec.name for v in variables if v.p_value is not None and v.p_value < INPUT_P_BAR]
    said = numbers.fixed(errors[worst], 1, (INPUT_ERRORS_BAR,))
    text = (
        f"Means, sigmas and correlations are within {said} standard errors of what was asked (farthest: {worst}); "
        "no value is outside its bounds."
    )
    if off:
        text += f" The distribution of {', '.join(off)} is not the one asked for (Kolmogorov)."
    return Check(name, "attention" if off or errors[worst] > INPUT_ERRORS_BAR else "good", text, errors[worst])


def _moments(variable: "VariableAnalysis") -> tuple[tuple[str, float | None], tuple[str, float | None]]:
    """Return the errors of mean and sigma by name."""
    return ("mean", variable.mean_errors), ("sigma", variable.std_errors)
