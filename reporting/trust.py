"""The trust card, part one: did the simulation do what it promises, sample by sample.

Levels: "good", "attention" (read on before you sign), "bad" (do not sign), "info" (nothing to judge by).
"""

import math
from dataclasses import dataclass

import numpy as np

from reporting import format_numbers as numbers
from reporting.arrays import Array
from reporting.capability.convergence import DRIFT_BAR
from reporting.capability.intervals import cpk_half_width
from reporting.inputs import CorrelationAnalysis, VariableAnalysis
from reporting.response import ResponseAnalysis
from reporting.samples import OK, Samples
from reporting.spec import ReportSpec

# What the project promises of every ok row: relative residual of the friction problem, gap violation by unit.
RESIDUAL_BAR = 1e-6
PENETRATION_BAR = {"mm": 1e-6, "m": 1e-9}
OK_SHARE_BAR = 0.99
# Cpk known to +-5 %: the usual wish; at Cpk 1.33 it takes 874 samples.
WANTED_HALF_WIDTH = 0.05
# A drawn mean, sigma or correlation this many standard errors off the requested one does not happen by chance.
INPUT_ERRORS_BAR = 4.0
# Nor does a distribution as far off as happens once in so many campaigns and variables.
INPUT_P_BAR = 1e-5


@dataclass(frozen=True)
class Check:
    """One line of the trust card: what was checked, the level, a sentence, and its number if it has one."""

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
    """Check that every sample asked for is there."""
    done = samples.sample.size
    text = f"{numbers.grouped(done)} of {numbers.grouped(requested)} samples asked for are done."
    if done < requested:
        text += " The campaign is not finished: every number below is provisional."
    return Check("Complete", "good" if done == requested else "attention", text, float(done))


def _failed(samples: Samples) -> Check:
    """Check that few samples failed, and say how the most frequent failure reads."""
    done, ok = samples.sample.size, int(np.count_nonzero(samples.ok))
    if done == 0:
        return Check("Failures", "bad", "No sample is done yet.")
    if ok == done:
        return Check("Failures", "good", "No sample failed.", 0.0)
    counts = {word: samples.rows_of(word).size for word in sorted(samples.statuses) if word != OK}
    worst = max(counts, key=counts.__getitem__)
    row = int(samples.rows_of(worst)[0])
    said = samples.messages.get(int(samples.sample[row]), "").strip() or "no message"
    text = (
        f"{numbers.grouped(done - ok)} of {numbers.grouped(done)} samples failed "
        f"({numbers.percent((done - ok) / done)}) and are in no statistic; most often {worst}, "
        f"first in sample {samples.sample[row]}: {said}"
    )
    level = "bad" if ok == 0 else "good" if ok / done >= OK_SHARE_BAR else "attention"
    return Check("Failures", level, text, float(done - ok))


def _largest(name: str, samples: Samples, values: Array, unit: str, bar: float | None) -> Check:
    """Check the largest of a certificate's numbers over the ok samples against its bar."""
    rows = np.flatnonzero(samples.ok)
    known = rows[np.isfinite(values[rows])]
    if known.size == 0:
        return Check(name, "info", f"No {OK} sample states it.")
    row = int(known[np.argmax(values[known])])
    most, suffix = float(values[row]), f" {unit}" if unit else ""
    said = f"{numbers.significant(most, 2)}{suffix}, sample {samples.sample[row]}"
    text = f"Largest over the ok samples: {said}"
    if known.size < rows.size:
        return Check(name, "bad", f"{text}; {rows.size - known.size} ok samples state none.", most)
    if bar is None:
        return Check(name, "info", f"{text}.", most)
    level = "good" if most <= bar else "bad"
    text += f"; {'within' if level == 'good' else 'over'} the bar of {numbers.plain(bar)}{suffix}."
    return Check(name, level, text, most)


def _settled(samples: Samples) -> Check:
    """Check that every ok sample came to rest."""
    total = int(np.count_nonzero(samples.ok))
    moving = total - int(np.count_nonzero(samples.settled & samples.ok))
    if total == 0:
        return Check("Settled", "info", "No ok sample.")
    if moving == 0:
        return Check("Settled", "good", "Every ok sample came to rest before its end.", 0.0)
    text = f"{numbers.grouped(moving)} ok samples ({numbers.percent(moving / total)}) were still moving when read."
    return Check("Settled", "attention", text, float(moving))


def _missing(responses: tuple[ResponseAnalysis, ...]) -> Check:
    """Check that every ok sample has a number for every response."""
    holes = [(r.spec.name, r.missing) for r in responses if r.missing]
    if not holes:
        return Check("Values", "good", "Every ok sample has a finite number for every response.", 0.0)
    listed = ", ".join(f"{name} {numbers.grouped(count)}" for name, count in holes)
    text = f"Ok samples without a finite number, left out of the statistics and counted as rejects: {listed}."
    return Check("Values", "bad", text, float(sum(count for _, count in holes)))


def _enough(responses: tuple[ResponseAnalysis, ...], *, production: bool) -> Check:
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


def _converged(responses: tuple[ResponseAnalysis, ...], *, production: bool) -> Check:
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


def _rejects(responses: tuple[ResponseAnalysis, ...], samples: Samples) -> Check:
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


def _shape(responses: tuple[ResponseAnalysis, ...]) -> Check:
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
    variables: tuple[VariableAnalysis, ...], correlations: tuple[CorrelationAnalysis, ...], *, production: bool
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


def _moments(variable: VariableAnalysis) -> tuple[tuple[str, float | None], tuple[str, float | None]]:
    """Return the errors of mean and sigma by name."""
    return ("mean", variable.mean_errors), ("sigma", variable.std_errors)
