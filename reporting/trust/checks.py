"""Lines of the trust card on the runs and their inputs, and the form of every line.

Each run is computed, succeeded, obeyed the laws of contact and came to rest; the inputs were drawn as requested.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from reporting import format_numbers
from reporting.inputs import CorrelationAnalysis, VariableAnalysis
from reporting.product_yield import AssemblyShare
from reporting.samples import OK, SHARES, TURN, Samples, too_few_ok

# A drawn mean, sigma or correlation does not deviate by more standard errors from the requested one by chance.
INPUT_ERRORS_BAR = 4.0
# A distribution does not have a smaller p-value by chance, even in many campaigns with many variables.
INPUT_P_BAR = 1e-5
# Bounds for every ok row: relative residual of the friction problem; penetration, by unit.
RESIDUAL_BAR = 1e-6
# The same length in both units; in any other unit there is no bound to compare with.
PENETRATION_BAR = {"mm": 1e-6, "m": 1e-9}
# Share of a run's largest kinetic energy that its steps may create or lose in all, and rotation of a body in a step.
ENERGY_BAR, TURN_BAR = 0.1, 0.5


@dataclass(frozen=True)
class Check:
    """One line of the trust card."""

    name: str  # of the checked property
    level: str  # "good"; "attention" (read on before signing); "bad" (do not sign); "info" (nothing to judge)
    text: str  # the finding in words
    value: float | None = None  # the number of the finding, if there is one


def complete(requested: int, done: int) -> Check:
    """Check that every requested sample is finished."""
    text = f"{format_numbers.grouped(done)} of {format_numbers.grouped(requested)} requested samples are computed."
    if done < requested:
        text += " The campaign is not finished: every number below is provisional."
    return Check("Complete", "good" if done == requested else "attention", text, float(done))


def assembles(fit: AssemblyShare) -> Check:
    """State how many samples cannot be assembled, and whether their share keeps its limit."""
    levels = {"kept": "good", "open": "attention", "exceeded": "bad", "": "attention"}
    text = f"{fit.words}."
    if not fit.verdict:
        text += " They count as failed samples; a limit of their own is failures.max_not_assemblable."
    return Check("Assembly", levels[fit.verdict], text, fit.share)


def failures(samples: Samples, min_ok: float) -> Check:
    """Check that no sample failed, or at least the share `min_ok` is ok; quote the most frequent failure."""
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
        f"({format_numbers.short_percent((done - ok) / done)}) and are left out of all statistics. Most frequent: "
        f"{worst}, first in sample {samples.sample[row]}: {message.rstrip('.')}."
    )
    if too_few_ok(ok, done, min_ok):
        needed = format_numbers.short_percent(min_ok)
        text += f" No response gets a verdict, because less than {needed} of the samples are ok (failures.min_ok)."
        return Check("Failures", "bad", text, float(done - ok))
    return Check("Failures", "attention", text, float(done - ok))


def largest(name: str, samples: Samples, column: str, unit: str, bar: float | None) -> Check:
    """Check the largest value of a certificate column over the ok samples against its bound."""
    ok, found = int(np.count_nonzero(samples.ok)), samples.largest[column]
    if found.stated == 0:
        return Check(name, "info", f"No {OK} sample has this number.")
    most, suffix = found.value, f" {unit}" if unit else ""
    text = f"Largest over the ok samples: {format_numbers.significant(most, 2)}{suffix}, sample {found.sample}"
    # An ok sample without the number may be over the bound, whatever the largest of the others is.
    if found.stated < ok:
        return Check(name, "bad", f"{text}; {ok - found.stated} ok samples do not have it.", most)
    if bar is None:
        return Check(name, "info", f"{text}.", most)
    level = "good" if most <= bar else "bad"
    text += f"; {'within' if level == 'good' else 'over'} the bound of {format_numbers.plain(bar)}{suffix}."
    return Check(name, level, text, most)


def energy(samples: Samples) -> Iterator[Check]:
    """Check the energy that steps created and lost, and how far bodies turned in them; nothing for earlier builds."""
    ok = int(np.count_nonzero(samples.ok))
    if TURN not in samples.largest or ok == 0:
        return
    shares = [samples.largest[name] for name in SHARES]
    missing = ok - shares[0].stated
    if missing:
        yield Check("Energy", "bad", f"{missing} ok samples do not have the energy that their steps created and lost.")
    else:
        most = [share.value for share in shares]
        created, lost = map(format_numbers.short_percent, most)
        text = (
            f"Steps created at most {created} of a run's largest kinetic energy, and lost at most {lost}"
            f" (largest: sample {shares[int(np.argmax(most))].sample}); "
        )
        # what was lost on the way to a pose at rest does not change it
        at_rest = bool(samples.settled[samples.ok].all())
        good = most[0] <= ENERGY_BAR and (at_rest or most[1] <= ENERGY_BAR)
        over = "all runs end at rest, where losses on the way do not count"
        over = over if good else "the motion is not accurate: use shorter steps"
        bound = format_numbers.short_percent(ENERGY_BAR)
        text += f"within the bound of {bound}." if max(most) <= ENERGY_BAR else f"over the bound of {bound}; {over}."
        yield Check("Energy", "good" if good else "attention", text, max(most))
    yield largest("Rotation in a step", samples, TURN, "rad", TURN_BAR)


def settled(samples: Samples) -> Check:
    """Check that every ok sample came to rest."""
    total = int(np.count_nonzero(samples.ok))
    moving = total - int(np.count_nonzero(samples.settled & samples.ok))
    if total == 0:
        return Check("Settled", "info", "No ok sample.")
    if moving == 0:
        return Check("Settled", "good", "Every ok sample came to rest before its run ended.", 0.0)
    share = format_numbers.percent(moving / total)
    text = f"{format_numbers.grouped(moving)} ok samples ({share}) were still moving when their run ended."
    return Check("Settled", "attention", text, float(moving))


def accidents(samples: Samples) -> tuple[Check, ...]:
    """Check whether values hang on the length of a step or on how a sample came to rest; nothing where none does."""
    checks, total = [], int(np.count_nonzero(samples.ok))
    counts = {name: int(np.count_nonzero(struck & samples.ok)) for name, struck in samples.at_impact.items()}
    if any(counts.values()):
        which = ", ".join(f"{name} ({format_numbers.grouped(count)})" for name, count in counts.items() if count)
        text = f"Forces in the step of an impact are no property of the mechanism: {which}."
        checks.append(Check("Forces at impacts", "attention", text, float(max(counts.values()))))
    held = 0 if samples.ambiguous is None else int(np.count_nonzero(samples.ambiguous & samples.ok))
    if held:
        share = format_numbers.percent(held / total)
        text = (
            f"{format_numbers.grouped(held)} ok samples ({share}) rest where motion would solve the equations as well: "
            "friction holds them as it held them before. Whether parts hold depends on how they came there."
        )
        checks.append(Check("Self-locking", "attention", text, float(held)))
    return tuple(checks)


def drawn_as_requested(
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
