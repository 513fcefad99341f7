"""The trust card: before any number is believed, what it rests on.

Each check is a pure function of the samples and says in a sentence what it found. Levels: "good", "attention"
(read before you sign), "bad" (do not sign), "info" (nothing to judge by).
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from reporting import numbers
from reporting.intervals import cpk_half_width
from reporting.samples import OK, Samples
from reporting.spec import ReportSpec

if TYPE_CHECKING:
    from reporting.analysis import ResponseAnalysis, VariableAnalysis

# What the project promises of every ok row: relative residual of the friction problem, gap violation by unit.
RESIDUAL_BAR = 1e-6
PENETRATION_BAR = {"mm": 1e-6, "m": 1e-9}
OK_SHARE_BAR = 0.99
# Cpk known to +-5 %: the usual wish; at Cpk 1.33 it takes 874 samples.
WANTED_HALF_WIDTH = 0.05
# A drawn mean or sigma this many standard errors off the requested one does not happen by chance.
INPUT_ERRORS_BAR = 4.0
# Beyond these, the normal ppm is no longer a fair guess of the tails.
SKEWNESS_BAR, KURTOSIS_BAR = 0.5, 1.0


@dataclass(frozen=True)
class Check:
    """One line of the trust card: what was checked, the level, a sentence, and its number if it has one."""

    name: str
    level: str
    text: str
    value: float | None = None


CORNERS = Check(
    "Sampling",
    "attention",
    "The samples are the corners of the variables' ranges and their middle, not a production: read the worst case; "
    "sigma, indices and ppm describe the corners only.",
)


def trust_checks(
    spec: ReportSpec,
    samples: Samples,
    responses: "tuple[ResponseAnalysis, ...]",
    variables: "tuple[VariableAnalysis, ...]",
) -> tuple[Check, ...]:
    """Return the lines of the trust card, in reading order."""
    return (
        *([CORNERS] if spec.sampler == "worst_case" else []),
        _complete(spec.requested, samples),
        _failed(samples),
        _largest("Friction residual", samples, samples.max_residual, "", RESIDUAL_BAR),
        _largest(
            "Penetration",
            samples,
            samples.max_penetration,
            samples.penetration_unit,
            PENETRATION_BAR.get(samples.penetration_unit),
        ),
        _settled(samples),
        _missing(responses),
        _enough(responses),
        _shape(responses),
        _inputs(variables),
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
    failed = samples.status[~samples.ok]
    names, counts = np.unique(failed, return_counts=True)
    worst = str(names[np.argmax(counts)])
    row = int(np.flatnonzero(samples.status == worst)[0])
    said = str(samples.message[row]).strip() or "no message"
    text = (
        f"{numbers.grouped(done - ok)} of {numbers.grouped(done)} samples failed "
        f"({numbers.percent((done - ok) / done)}) and are in no statistic; most often {worst}, "
        f"first in sample {samples.sample[row]}: {said}"
    )
    level = "bad" if ok == 0 else "good" if ok / done >= OK_SHARE_BAR else "attention"
    return Check("Failures", level, text, float(done - ok))


def _largest(name: str, samples: Samples, values: NDArray[np.float64], unit: str, bar: float | None) -> Check:
    """Check the largest of a certificate's numbers over the ok samples against its bar."""
    rows = np.flatnonzero(samples.ok)
    known = rows[np.isfinite(values[rows])]
    if known.size == 0:
        return Check(name, "info", f"No {OK} sample states it.")
    row = int(known[np.argmax(values[known])])
    largest, suffix = float(values[row]), f" {unit}" if unit else ""
    said = f"{numbers.significant(largest, 2)}{suffix}, sample {samples.sample[row]}"
    text = f"Largest over the ok samples: {said}"
    if known.size < rows.size:
        return Check(name, "bad", f"{text}; {rows.size - known.size} ok samples state none.", largest)
    if bar is None:
        return Check(name, "info", f"{text}.", largest)
    level = "good" if largest <= bar else "bad"
    text += f"; {'within' if level == 'good' else 'over'} the bar of {numbers.plain(bar)}{suffix}."
    return Check(name, level, text, largest)


def _settled(samples: Samples) -> Check:
    """Check that every ok sample came to rest."""
    total = int(np.count_nonzero(samples.ok))
    moving = total - int(np.count_nonzero(samples.settled & samples.ok))
    if total == 0:
        return Check("Settled", "info", "No ok sample.")
    if moving == 0:
        return Check("Settled", "good", "Every ok sample came to rest before its end.", 0.0)
    text = f"{numbers.grouped(moving)} ok samples were still moving when they were read."
    return Check("Settled", "attention", text, float(moving))


def _missing(responses: "tuple[ResponseAnalysis, ...]") -> Check:
    """Check that every ok sample has a number for every response."""
    holes = [(r.spec.name, r.missing) for r in responses if r.missing]
    if not holes:
        return Check("Values", "good", "Every ok sample has a finite number for every response.", 0.0)
    listed = ", ".join(f"{name} {numbers.grouped(count)}" for name, count in holes)
    text = f"Ok samples without a finite number, left out of the statistics and counted as rejects: {listed}."
    return Check("Values", "bad", text, float(sum(count for _, count in holes)))


def _enough(responses: "tuple[ResponseAnalysis, ...]") -> Check:
    """Check that Cpk is known well enough to stand by every verdict."""
    known = [(r, r.capability) for r in responses if r.capability.cpk is not None]
    if not known:
        return Check("Enough samples", "info", "No response has a Cpk.")
    # Near Cpk 0 a relative width means nothing: below 1 the width is taken relative to 1.
    widths = [cpk_half_width(c.cpk or 0.0, c.n, c.confidence) / max(abs(c.cpk or 0.0), 1.0) for _, c in known]
    at = int(np.argmax(widths))
    response, c = known[at]
    text = f"Cpk is known to ±{numbers.percent(widths[at])} or better (widest: {response.spec.name})"
    if widths[at] > WANTED_HALF_WIDTH:
        needed = math.ceil(c.n * (widths[at] / WANTED_HALF_WIDTH) ** 2)
        text += f"; about {numbers.grouped(round(needed, 2 - len(str(needed))))} samples would make it ±5 %"
    unsure = [r.spec.name for r, _ in known if not r.certain]
    if unsure:
        text += f". The interval reaches another verdict for {', '.join(unsure)}: it takes more samples to decide"
    return Check("Enough samples", "attention" if unsure else "good", f"{text}.", widths[at])


def _shape(responses: "tuple[ResponseAnalysis, ...]") -> Check:
    """Check by effect size that normal is a fair guess: at 30,000 samples every test rejects it."""
    known = [r for r in responses if r.capability.cpk is not None and r.capability.skewness is not None]
    if not known:
        return Check("Shape", "info", "No response with limits has a shape.")
    odd = [
        r.spec.name
        for r in known
        if abs(r.capability.skewness or 0.0) > SKEWNESS_BAR or abs(r.capability.kurtosis or 0.0) > KURTOSIS_BAR
    ]
    if odd:
        text = f"Not close to normal: {', '.join(odd)}. Trust the observed ppm there, not Cpk and expected ppm."
        return Check("Shape", "attention", text, float(len(odd)))
    bars = f"|skewness| up to {SKEWNESS_BAR}, |excess kurtosis| up to {KURTOSIS_BAR:g}"
    return Check("Shape", "good", f"Every response with limits is close to normal ({bars}).", 0.0)


def _inputs(variables: "tuple[VariableAnalysis, ...]") -> Check:
    """Check that the drawn inputs have the requested mean, sigma and bounds."""
    if not variables:
        return Check("Inputs as asked", "info", "No variable.")
    outside = sum(v.outside for v in variables)
    errors = {v.spec.name: input_errors(v) for v in variables}
    known = {name: error for name, error in errors.items() if error is not None}
    if outside:
        text = f"{numbers.grouped(outside)} drawn values are outside the requested bounds or missing."
        return Check("Inputs as asked", "bad", text, float(outside))
    if not known:
        return Check("Inputs as asked", "info", "Too few samples to compare with what was asked.")
    worst = max(known, key=known.__getitem__)
    errors_off = numbers.fixed(known[worst], 1, (INPUT_ERRORS_BAR,))
    text = (
        f"Means and sigmas are within {errors_off} standard errors of "
        f"what was asked (farthest: {worst}); no value is outside its bounds."
    )
    return Check("Inputs as asked", "good" if known[worst] <= INPUT_ERRORS_BAR else "attention", text, known[worst])


def input_errors(variable: "VariableAnalysis") -> float | None:
    """Return how many standard errors the drawn mean or sigma is off; None below 30 values or for sigma 0.

    The standard error of sigma is that of a normal distribution.
    """
    asked = variable.spec
    if variable.n < 30 or asked.std <= 0 or variable.mean is None or variable.std is None:
        return None
    of_mean = asked.std / math.sqrt(variable.n)
    of_std = asked.std / math.sqrt(2 * variable.n)
    return max(abs(variable.mean - asked.mean) / of_mean, abs(variable.std - asked.std) / of_std)
