"""The lines of the trust card, in reading order.

They check that the campaign is complete, that the simulation meets its bounds in every sample, and that the
statistics support the verdicts.
"""

from reporting import format_numbers
from reporting.format_numbers import grouped
from reporting.inputs import CorrelationAnalysis, VariableAnalysis
from reporting.product_yield import AssemblyShare
from reporting.response import ResponseAnalysis
from reporting.samples import Repeats, Samples
from reporting.sensitivity.repeatability import FEWEST_PAIRS, NOTABLE_SHARE, Repeatability
from reporting.spec import INDEPENDENT, ReportSpec
from reporting.trust.checks import (
    PENETRATION_BAR,
    RESIDUAL_BAR,
    Check,
    accidents,
    assembles,
    complete,
    drawn_as_requested,
    energy,
    failures,
    largest,
    settled,
)
from reporting.trust.evidence import (
    converged,
    enough_samples,
    failures_as_rejects,
    gauges,
    limits_in_place,
    many_statements,
    missing_values,
    normal_shape,
    production_lots,
    row_order,
    stability,
    time_models,
    verdicts_hold,
)

_ORDER = {True: "in the order in which they were made", False: "in an order that means nothing"}


def trust_checks(
    spec: ReportSpec,
    samples: Samples,
    responses: tuple[ResponseAnalysis, ...],
    variables: tuple[VariableAnalysis, ...],
    correlations: tuple[CorrelationAnalysis, ...],
    confidence: float,
    fit: AssemblyShare | None = None,
) -> tuple[Check, ...]:
    """Return the lines of the trust card, in reading order, of the samples that can be assembled."""
    unit, design = samples.penetration_unit, spec.design
    if spec.measured:
        return _checks_of_parts(spec, samples, responses, confidence)
    sampling = design.text
    if samples.lots is not None and design == INDEPENDENT:
        sampling = "Random samples in production lots; those of one lot are not independent of each other."
    return (
        Check("Sampling", "info" if design.production else "attention", sampling),
        *production_lots(responses),
        complete(spec.requested, samples.sample.size if fit is None else fit.n),
        enough_samples(responses, production=design.production),
        verdicts_hold(responses),
        *([many_statements(responses, confidence)] if design.production else []),
        converged(responses, production=design.production),
        *(row_order(responses) if design.production else ()),
        *([Check("Stopping rule", "info", spec.stop)] if spec.stop else []),
        *([] if fit is None else [assembles(fit)]),
        failures(samples, spec.min_ok),
        failures_as_rejects(responses, samples),
        missing_values(responses),
        *limits_in_place(responses),
        normal_shape(responses),
        largest("Friction residual", samples, "max_residual", "", RESIDUAL_BAR),
        largest("Penetration", samples, "max_penetration", unit, PENETRATION_BAR.get(unit)),
        *energy(samples),
        settled(samples),
        *accidents(samples),
        drawn_as_requested(variables, correlations, production=design.production),
    )


def _checks_of_parts(
    spec: ReportSpec, samples: Samples, responses: tuple[ResponseAnalysis, ...], confidence: float
) -> tuple[Check, ...]:
    """Return the lines on measured parts; stability comes first, because no index predicts an unstable process."""
    parts = f"{grouped(samples.sample.size)} measured parts, {_ORDER[spec.ordered]}."
    return (
        stability(responses, ordered=spec.ordered),
        *time_models(responses),
        Check("Parts", "info", parts),
        *gauges(responses),
        *production_lots(responses),
        enough_samples(responses, production=True),
        verdicts_hold(responses),
        many_statements(responses, confidence),
        converged(responses, production=True),
        *(row_order(responses) if spec.ordered else ()),
        missing_values(responses, measured=True),
        *limits_in_place(responses),
        normal_shape(responses),
    )


# Line of the trust card on repeats: whether runs of the same sample with different steps agree.

NAME = "Repeatability"
NOTABLE_SHIFT = 0.3  # of the response's sigma: permitted shift of the mean when the step is halved
_NEXT_TO_NOTHING = 0.001  # of the variance
_ENOUGH = 60  # pairs: enough that one shows a scatter present in a twentieth of the samples


def repeatable(responses: tuple[ResponseAnalysis, ...], repeats: Repeats | None) -> Check:
    """Check how much of the variance of the responses remains if only the step changes."""
    remedy = f" {repeats.remedy}" if repeats and repeats.remedy else ""
    if repeats is None or not repeats.planned:
        text = "No sample was repeated with half the step, so the scatter of the results themselves is not known."
        return Check(NAME, "info", f"{text}{remedy}")
    found = {r.spec.name: (r, r.repeatability) for r in responses if r.repeatability and r.repeatability.pairs > 1}
    if not found:
        done = f"{repeats.sample.size} of {repeats.planned}"
        text = f"{done} repeats with half the step are computed, too few to compare."
        return Check(NAME, "info", f"{text}{remedy}")
    scattering = {name for name, (_, f) in found.items() if (f.share or 0.0) >= NOTABLE_SHARE}
    moving = [(r, f) for r, f in found.values() if _is_moved(r, f)]
    dependent = [name for name, (_, f) in found.items() if f.beyond_rows is not None]
    sentences = _scatter([found[name] for name in found if name in scattering])
    sentences += _others([(r, f) for name, (r, f) in found.items() if name not in scattering], bool(scattering))
    sentences += [
        f"Halving the step shifts the mean of {r.spec.name} by {_with_unit(r, f.shift)}: the step is too long for it."
        for r, f in moving
    ]
    if dependent:
        sentences.append(
            f"In {', '.join(dependent)} runs with half the step differ by more than the inputs leave unexplained: the "
            "result depends on the step, which is not scatter of the samples."
        )
    sentences += _lost(repeats, found)
    sentences.append(f"{repeats.sample.size} samples were simulated a second time, with half the step.")
    pairs = min(f.pairs for _, f in found.values())
    unseen = max(f.unseen or 0.0 for _, f in found.values())
    if pairs < _ENOUGH:
        sentences.append(f"So few may miss scatter that occurs in up to {_percent(unseen)} of the samples.{remedy}")
    unsure = any(f.share_interval is None or f.share_interval[1] >= NOTABLE_SHARE for _, f in found.values())
    is_attention = scattering or moving or dependent or any(f.lost for _, f in found.values())
    level = "attention" if is_attention else "info" if unsure else "good"
    shares = [f.share for _, f in found.values() if f.share is not None]
    return Check(NAME, level, " ".join(sentences), max(shares, default=None))


def _scatter(some: list[tuple[ResponseAnalysis, Repeatability]]) -> list[str]:
    """Return how much of the variance of some responses is scatter, and the consequences."""
    if not some:
        return []
    shares = []
    for r, f in some:
        ends = "" if f.share_interval is None else f" ({' to '.join(map(_percent, f.share_interval))})"
        shares.append(f"{r.spec.name} {_percent(f.share)}{ends}, sigma {_with_unit(r, f.sigma)}")
    least, name = min((f.removable or 0.0, r.spec.name) for r, f in some)
    return [
        f"Part of the variance is scatter that no input causes: {'; '.join(shares)}. Neither tighter tolerances nor "
        f"more samples remove it: all variables together explain at most {_percent(least)} of the variance of {name}."
    ]


def _others(rest: list[tuple[ResponseAnalysis, Repeatability]], some: bool) -> list[str]:
    """Return the largest scatter of the other responses."""
    known = [(f.share, r, f) for r, f in rest if f.share is not None]
    sentences = []
    if known:
        share, response, found = max(known, key=lambda each: each[0])
        to = "" if found.share_interval is None else f" (up to {_percent(found.share_interval[1])})"
        which = "the other responses" if some else "every response"
        text = f"In {which} scatter is at most {_percent(share)}{to} of the variance ({response.spec.name})."
        least = share if found.share_interval is None else found.share_interval[1]
        if least < _NEXT_TO_NOTHING:
            text = f"In {which} scatter is less than {_percent(_NEXT_TO_NOTHING)} of the variance."
        sentences.append(text)
    unknown = [f"{r.spec.name} {_with_unit(r, f.sigma)}" for r, f in rest if f.share is None and f.sigma]
    if unknown:
        sentences.append(f"Sigma of the scatter: {', '.join(unknown)}.")
    few = [f.pairs for _, f in rest if f.pairs < FEWEST_PAIRS]
    if few:
        sentences.append(f"{min(few)} pairs are too few for an interval.")
    return sentences


def _is_moved(response: ResponseAnalysis, found: Repeatability) -> bool:
    """Return whether half the step shifts the mean of a response notably and beyond chance."""
    if found.shift is None or found.shift_interval is None or not response.capability.std:
        return False
    low, high = found.shift_interval
    return not low <= 0.0 <= high and abs(found.shift) >= NOTABLE_SHIFT * response.capability.std


def _lost(repeats: Repeats, found: dict[str, tuple[ResponseAnalysis, Repeatability]]) -> list[str]:
    """Return how many repeats failed, and for how many samples only one of the two runs succeeded."""
    failed = int(repeats.sample.size - repeats.ok.sum())
    lost = max(f.lost for _, f in found.values())
    if lost:
        samples = "one sample" if lost == 1 else f"{lost} samples"
        return [f"For {samples} only one of the two runs succeeded: whether a run succeeds depends on the step."]
    if failed:
        return [f"{failed} repeat{'' if failed == 1 else 's'} failed, as the run of the same sample did."]
    return []


def _with_unit(response: ResponseAnalysis, number: float | None) -> str:
    unit = "" if response.spec.unit == "1" else f" {response.spec.unit}"
    return f"{format_numbers.significant(number or 0.0)}{unit}"


def _percent(share: float | None) -> str:
    """Return a share as percent, with one decimal below 10 %."""
    if share is None:
        return format_numbers.NONE
    # From 9.95 % on one decimal would round to 10.0 %.
    return f"{100 * share:.{1 if 0 < share < 0.0995 else 0}f} %"
