"""Line of the trust card on normality: which responses are not normal, in which tail, and the effect on the ppm."""

from reporting import format_numbers
from reporting.capability.verdict import FEWEST_FOR_A_VERDICT
from reporting.response import ResponseAnalysis
from reporting.shape.normality import PROVEN_P, departs
from reporting.trust.checks import Check

# A single response with a p-value below this would be called not normal.
PERHAPS_P = 0.05


def normal_shape(responses: tuple[ResponseAnalysis, ...]) -> Check:
    """Check that the responses with limits are close enough to normal for the printed ppm."""
    indexed = [r for r in responses if r.capability.cpk is not None]
    shaped = [r for r in indexed if r.normality.p is not None]
    untested = [r for r in indexed if r.normality.p is None and r.normality.distance_interval is not None]
    if not shaped and not untested:
        return Check("Shape", "info", "No response with limits has enough values to judge its shape.")
    # Of six normal responses one in four campaigns would have a p-value below 5 %.
    departing = [r for r in shaped if departs(r.normality, len(shaped)) or _proven(r)]
    rest = [r for r in shaped if r not in departing]
    doubtful = [r for r in rest if (r.normality.p or 0.0) < PERHAPS_P]
    rest = [r for r in rest if r not in doubtful]
    close = [r for r in rest if r.normality.verdict in ("normal", "close to normal")]
    open_ = [r for r in rest if r not in close]
    sentences = [_departure(r) for r in departing]
    if close:
        names = _named(close, len(indexed))
        sentences.append(f"{names}: close to normal, no cumulative share is off by more than {_farthest(close)}.")
    if open_:
        sentences.append(
            f"{_named(open_, len(indexed))}: no departure from normal found ({_smallest_p(open_)}), "
            f"but with {_so_few(open_)} cumulative shares may be off by up to {_farthest(open_)}."
        )
    if untested:
        sentences.append(
            f"{_named(untested, len(indexed))}: {_so_few(untested)} do not allow a test of the shape; "
            f"cumulative shares may be off by up to {_farthest(untested)}."
        )
    if doubtful:
        each = "; ".join(f"{r.spec.name} ({_how(r)})" for r in doubtful)
        by_chance = format_numbers.plain(round(PERHAPS_P * len(shaped), 1))
        sentences.append(
            f"Perhaps not normal, but none for certain (of {len(shaped)} normal responses about {by_chance} look like "
            f"this by chance): {each}."
        )
    misleading = [r for r in departing if _effects(r) or r.normality.verdict == "not normal"]
    level = "attention" if misleading else "info" if open_ or untested or departing or doubtful else "good"
    return Check("Shape", level, " ".join(sentences), float(len(departing)))


def _proven(response: ResponseAnalysis) -> bool:
    """Return whether the departure of a response is beyond chance even among many responses."""
    p = response.normality.anderson_darling_p
    return p is not None and p < PROVEN_P


def _departure(response: ResponseAnalysis) -> str:
    """Return a sentence on how a response departs from normal, and the effect on the printed ppm."""
    effects = "; ".join(_effects(response))
    return f"{response.spec.name} is not normal ({_how(response)}){f': {effects}' if effects else ''}."


def _how(response: ResponseAnalysis) -> str:
    """Return how much a response departs from normal, and in which tail."""
    shape = response.normality
    tails = [
        f"{'lower' if tail.side == 'below' else 'upper'} tail {tail.word}"
        for tail in shape.tails
        if tail.word != "like normal"
    ]
    where = " and ".join(tails) + " than normal" if tails else "no tail clearly heavier or lighter than normal"
    both = (("Anderson-Darling", shape.anderson_darling_p), ("including the tails", shape.p))
    named = [f"{name} p {_equals(p)}" for name, p in both if p is not None]
    return f"{', '.join(named)}, cumulative shares off by {format_numbers.percent(shape.distance)}, {where}"


def _equals(p: float) -> str:
    """Return a p-value with its relation sign."""
    text = format_numbers.probability(p)
    return text if text.startswith("<") else f"= {text}"


def _effects(response: ResponseAnalysis) -> list[str]:
    """Return what tails and count say about the expected ppm, for the sides with a limit."""
    spec, counted, expected = response.spec, response.nonconforming, response.capability.ppm_expected
    limits = {"below": spec.lsl, "above": spec.usl}
    effects = [
        f"the ppm that a normal distribution predicts {tail.side} the limit is too "
        f"{'small' if tail.word == 'heavier' else 'large'}"
        for tail in response.normality.tails
        if tail.word != "like normal" and limits[tail.side] is not None
    ]
    if counted is not None and expected is not None and counted.total.n >= FEWEST_FOR_A_VERDICT:
        low, high = counted.total.interval
        if not low <= expected <= high:
            effects.append(
                f"{format_numbers.ppm(counted.total.ppm)} ppm counted ({format_numbers.ppm(low)} to "
                f"{format_numbers.ppm(high)}) against {format_numbers.ppm(expected)} expected"
            )
    return effects


def _named(some: list[ResponseAnalysis], total: int) -> str:
    """Return the names of some of the responses with limits, or a word for all of them."""
    return "Every response with limits" if len(some) == total else ", ".join(r.spec.name for r in some)


def _farthest(some: list[ResponseAnalysis]) -> str:
    """Return the largest upper end of the intervals of the distance from a normal distribution."""
    return format_numbers.percent(max((r.normality.distance_interval or (0.0, 1.0))[1] for r in some))


def _so_few(some: list[ResponseAnalysis]) -> str:
    """Return the number of values in words; with lots, the smallest effective number of independent values."""
    effective = [r.capability.lots.effective for r in some if r.capability.lots is not None]
    return f"values in lots, worth {min(effective):.0f} independent ones," if effective else "so few values"


def _smallest_p(some: list[ResponseAnalysis]) -> str:
    """Return the smallest p-value of the test that judged the responses."""
    smallest = min((r.normality.p for r in some if r.normality.p is not None), default=None)
    return f"smallest p, tails included, {format_numbers.probability(smallest)}"
