"""Lines of the trust card on the statistics.

Enough samples, agreement of both halves and of the estimates, failures, missing values, the joint confidence of many
statements; and on rare rejects, whether their shares are known and whether the weights are correct.
"""

import math
from collections.abc import Iterable

from scipy.special import ndtri

from reporting import format_numbers
from reporting.capability.lots import FEW_LOTS
from reporting.capability.row_order import DRIFT_BAR, FALSE_ALARMS, ControlChart
from reporting.capability.verdict import FEWEST_FOR_A_VERDICT, bars_of
from reporting.gauge import ACCEPTABLE, UNACCEPTABLE
from reporting.rare.rare_rejects import CHECK_BAR, RareRejects
from reporting.response import ResponseAnalysis
from reporting.samples import Samples
from reporting.shape.normality import PROVEN_P, departs
from reporting.trust.checks import Check

_NO_PRODUCTION = "The samples do not represent production."
_TOO_FEW = "Too few samples to compare their halves."
# Cpk to +-5 % is a usual requirement; at Cpk 1.33 it needs 874 samples.
WANTED_HALF_WIDTH = 0.05
# An interval wider than +-25 % says little about Cpk, whatever class it lies in.
LOOSE_HALF_WIDTH = 0.25
# A larger allowance for regions without an aimed component, as a share of the rare share, gives a warning.
LOOSE_ALLOWANCE = 0.2
FEW = 3  # responses named in a line
# Points of a control chart beyond its limits that chance does not explain: at most 2.1 % of charts of stable normal,
# lognormal (0.3), gamma (16) and t (5) values have as many, from 20 to 1,000 values (docs/measured.md).
BEYOND_BAR = 3
BEYOND_SHARE = 0.05  # of the points, where there are more than 60


def enough_samples(responses: tuple[ResponseAnalysis, ...], *, production: bool) -> Check:
    """Check that there are enough values for a verdict, and that the intervals of Cpk are narrow enough."""
    name = "Enough samples"
    indexed = [(r, r.capability) for r in responses if r.capability.cpk is not None]
    if not indexed or not production:
        return Check(name, "info", _NO_PRODUCTION if indexed else "No response has a Cpk.")
    withheld = [r.spec.name for r, c in indexed if c.cpk_interval is None]
    if withheld:
        reason = next(c.interval_reason for _, c in indexed if c.cpk_interval is None)
        return Check(name, "attention", f"No interval for Cpk of {', '.join(withheld)}: {reason}")
    # A width relative to a Cpk near 0 is meaningless: for a Cpk below 1 it is relative to 1.
    intervals = [c.cpk_interval or (-math.inf, math.inf) for _, c in indexed]
    widths = [(i[1] - i[0]) / (2 * max(abs(c.cpk or 0.0), 1.0)) for i, (_, c) in zip(intervals, indexed, strict=True)]
    at = widths.index(max(widths))
    response, c = indexed[at]
    counted, what = (c.n, "samples") if c.lots is None else (c.lots.count, "production lots")
    two_digits = format_numbers.plain(float(f"{100 * widths[at]:.2g}"))  # such as 44 %, 110 % or 4.9 %
    text = f"Least certain Cpk: {response.spec.name}, ±{format_numbers.grouped(two_digits)}\u00a0%"
    if widths[at] > WANTED_HALF_WIDTH:
        # The width of an interval falls as 1 / sqrt(n).
        needed = math.ceil(counted * (widths[at] / WANTED_HALF_WIDTH) ** 2)
        text += f"; about {format_numbers.grouped(round(needed, 2 - len(str(needed))))} {what} would give ±5\u00a0%"
    uncertain = [r for r, c in indexed if not r.verdict.certain and _covers_classes(r, c.cpk_interval or ())]
    if uncertain:
        what = "samples" if all(c.lots is None for _, c in indexed) else "production lots"
        text += f". {'; '.join(map(_open_classes, uncertain))}: more {what} may decide"
    fewest = min(c.n for _, c in indexed)
    if fewest < FEWEST_FOR_A_VERDICT:
        text = f"{fewest} values are too few for a verdict: at least {FEWEST_FOR_A_VERDICT} are needed. {text}"
    enough = not uncertain and fewest >= FEWEST_FOR_A_VERDICT and widths[at] <= LOOSE_HALF_WIDTH
    return Check(name, "good" if enough else "attention", f"{text}.", widths[at])


def production_lots(responses: tuple[ResponseAnalysis, ...]) -> tuple[Check, ...]:
    """State the effect of production lots on the intervals; empty without lots."""
    described = [(r.capability.lots, r.spec.name) for r in responses if r.capability.lots is not None]
    if not described:
        return ()
    lots, name = min(described, key=lambda pair: pair[0].effective)
    if not lots.enough:
        few = f"The samples are of {lots.count} production lots"
        if lots.count == 1:
            few = "All samples are of one production lot"
        text = f"{few}, which share a shift: intervals need at least {lots.least} lots, so there are none."
        return (Check("Production lots", "attention", text, float(lots.count)),)
    text = (
        f"Samples of one production lot share a shift. For the mean of {name} the {lots.count} lots are worth "
        f"{format_numbers.grouped(round(lots.effective))} independent samples, for the other responses at least as "
        "many. All intervals are computed from the differences between lots."
    )
    if lots.blind:
        text += f" {lots.blind}"
    level = "attention" if round(lots.worth) < FEW_LOTS else "info"
    return (Check("Production lots", level, text, float(lots.count)),)


def converged(responses: tuple[ResponseAnalysis, ...], *, production: bool) -> Check:
    """Check that the first and the second half of the samples agree."""
    drifts = {r.spec.name: abs(r.running.drift) for r in responses if r.running and r.running.drift is not None}
    if not drifts or not production:
        return Check("Converged", "info", _TOO_FEW if production else _NO_PRODUCTION)
    name = max(drifts, key=drifts.__getitem__)
    errors = format_numbers.fixed(drifts[name], 1, (DRIFT_BAR,))
    text = f"The two halves of the samples differ by at most {errors} standard errors of an index ({name})"
    if drifts[name] <= DRIFT_BAR:
        return Check("Converged", "good", f"{text}, no more than by chance.", drifts[name])
    return Check(
        "Converged", "attention", f"{text}, too much for chance: something changed during the campaign.", drifts[name]
    )


def row_order(responses: tuple[ResponseAnalysis, ...]) -> tuple[Check, ...]:
    """Say where the values drift from row to row, or resemble their neighbours; nothing where their order is chance."""
    name, tested = "Order of the rows", [(r.spec.name, r.capability.order) for r in responses if r.capability.order]
    if not tested:
        return ()
    found = [f"{response}: {order.finding}" for response, order in tested if order.finding]
    smallest_p = min(order.p for _, order in tested)
    if not found:
        text = "No response drifts from row to row, and neighbours neither resemble each other nor differ beyond chance"
        unseen = min((order for _, order in tested), key=lambda order: order.n).unseen
        text = f"{text} (smallest p {format_numbers.probability(smallest_p)}). {unseen}".rstrip()
        return (Check(name, "good", text, smallest_p),)
    alarm = f"By chance alone this is said of {100 * FALSE_ALARMS:.0f} % of stable responses."
    return (Check(name, "attention", f"{' '.join(found)} {alarm}", smallest_p),)


def stability(responses: tuple[ResponseAnalysis, ...], *, ordered: bool) -> Check:
    """Check that measured values come from a stable process, by their control charts and the tests of their order."""
    name, charts = "Stability", [(r, r.chart) for r in responses if r.chart is not None]
    if not ordered:
        text = (
            "The order in which the parts were made is not stated, so nothing shows whether the process is stable: the "
            "indices describe these parts, not the next ones."
        )
        return Check(name, "info", text)
    if not charts:
        return Check(name, "info", "There are too few values for a control chart.")
    most = max(len(chart.beyond) for _, chart in charts)
    found = [f"{r.spec.name}, {words}" for r, chart in charts for words in _instability(r, chart)]
    if not found:
        text = f"At most {most} points of a control chart lie beyond its limits, and the order of the values is random."
        return Check(name, "good", text, float(most))
    text = (
        f"Not stable: {'; '.join(found)}. The indices describe these parts (performance, ISO 22514-2), not what the "
        "process will make. Find the cause first. By chance, this is said of at most 5 of 100 stable processes, even "
        "if their values are skew."
    )
    return Check(name, "bad", text, float(most))


def time_models(responses: tuple[ResponseAnalysis, ...]) -> tuple[Check, ...]:
    """Name the model class of each measured characteristic, and what it rests on; nothing where parts are in no order.

    Only of a process of constant location and spread does an index say what it will make (ISO 22514-2).
    """
    found = [(r.spec.name, r.time_model) for r in responses if r.time_model is not None]
    if not found:
        return ()
    is_stable = all(each.name in ("A1", "A2", "") for _, each in found)
    is_proved = all(each.name and not each.possible for _, each in found)
    level = "attention" if not is_stable else "good" if is_proved else "info"
    text = " ".join(f"{response}: {each.text}" for response, each in found)
    return (Check("Model class (ISO 22514-2)", level, text),)


def _instability(response: ResponseAnalysis, chart: ControlChart) -> list[str]:
    """Return what shows that the process of a characteristic is not stable, in words."""
    found, points = [], len(chart.points)
    if len(chart.beyond) >= max(BEYOND_BAR, BEYOND_SHARE * points):
        found.append(f"{len(chart.beyond)} of {points} points beyond the control limits")
    if response.capability.order and response.capability.order.finding:
        found.append("not in a random order")
    if chart.p is not None and chart.p <= FALSE_ALARMS / 2:
        broken = ", ".join(f"{rule}: {len(those)}" for rule, those in chart.marks.items() if those)
        found.append(f"more marked points than random orders of the values have ({broken})")
    if chart.spread is not None and chart.spread.p is not None and chart.spread.p <= FALSE_ALARMS / 2:
        found.append(f"{chart.spread.of} that vary more than in random orders of the values")
    return found


def gauges(responses: tuple[ResponseAnalysis, ...]) -> tuple[Check, ...]:
    """Check how much of the variation the gauges make, and whether conformity is proved; empty if nothing is stated."""
    stated = [r for r in responses if r.gauge is not None or r.conformity is not None]
    if not stated:
        return ()
    words, levels, most = [], {"good"}, 0.0
    for r in stated:
        if r.gauge is not None:
            of = r.gauge.of_tolerance
            most = max(most, math.sqrt(r.gauge.share) if of is None else of)
            said = f"{r.spec.name}: gauge {format_numbers.percent(min(r.gauge.share, 1.0))} of the variance"
            said += "" if of is None else f", {format_numbers.percent(of)} of the tolerance"
            said += "" if r.gauge.cpk is None else f", Cpk without it {format_numbers.index(r.gauge.cpk)}"
            words.append(said + (f". {r.gauge.note.rstrip('.')}" if r.gauge.note else ""))
            levels |= {"bad" if most > UNACCEPTABLE else "attention" if most > ACCEPTABLE or r.gauge.note else "good"}
        if r.conformity is not None:
            found = r.conformity
            if found.low is not None and found.high is not None and not found.low < found.high:
                levels.add("bad")
                words.append(f"{r.spec.name}: the uncertainty takes the whole tolerance, no value proves conformity")
                continue
            levels |= {"attention"} if found.undecided else set()
            words.append(
                f"{r.spec.name}: {found.conforming} parts proved to conform, {found.nonconforming} not to,"
                f" {found.undecided} undecided within the uncertainty of a limit (ISO 14253-1)"
            )
    level = next(level for level in ("bad", "attention", "good") if level in levels)
    return (Check("Gauge", level, f"{'; '.join(words)}.", most),)


def verdicts_hold(responses: tuple[ResponseAnalysis, ...]) -> Check:
    """Check that every verdict is certain, and quote the evidence against those that are not."""
    judged = [r for r in responses if r.verdict.certain is not None]
    if not judged:
        return Check("Verdicts", "info", "No response has a verdict.")
    doubtful = [r for r in judged if r.verdict.reasons]
    if not doubtful:
        return Check("Verdicts", "good", "Cpk, count of rejects and all other estimates agree on every verdict.", 0.0)
    alike: dict[str, list[str]] = {}
    for r in doubtful:
        word = r.verdict.word + ("" if r.verdict.certain else ", not certain")
        alike.setdefault(f"({word}): {' '.join(r.verdict.reasons)}", []).append(r.spec.name)
    leads = (
        ("Not certain", [r for r in doubtful if not r.verdict.certain]),
        ("Not by Cpk", [r for r in doubtful if r.verdict.certain]),
    )
    lead = [f"{what}: {', '.join(r.spec.name for r in those)}." for what, those in leads if those]
    text = " ".join([*lead, *(f"{', '.join(names)} {words}" for words, names in alike.items())])
    return Check("Verdicts", "attention", text, float(len(doubtful)))


def many_statements(responses: tuple[ResponseAnalysis, ...], confidence: float) -> Check:
    """State how many of the page's intervals may be wrong by chance, and which verdicts hold jointly."""
    certain = [r for r in responses if r.verdict.certain]
    shares = sum(
        influence.first_order_interval is not None
        for r in responses
        if r.sensitivity
        for influence in r.sensitivity.influences
    )
    judged = [r for r in responses if r.verdict.certain is not None]
    count = len(judged) + shares
    level = f"{format_numbers.plain(round(100 * confidence, 1))} %"
    if count < 2:
        return Check("All at once", "info", f"Each interval contains the true value in {level} of all cases.")
    missing = format_numbers.plain(round(count * (1 - confidence), 1))
    kinds = f"{len(judged)} verdict{'' if len(judged) == 1 else 's'}"
    kinds += f", {shares} share{'' if shares == 1 else 's'} of variables" if shares else ""
    text = f"{count} statements at {level} each ({kinds}): expect about {missing} to be wrong."
    if len(certain) > 1:
        together = [r.spec.name for r in certain if _certain_among(r, len(judged), confidence)]
        names = "all certain ones" if len(together) == len(certain) else ", ".join(together) or "none"
        text += f" Verdicts that hold at {level} all at once (Bonferroni): {names}."
    return Check("All at once", "info", text, count * (1 - confidence))


def _certain_among(response: ResponseAnalysis, judged: int, confidence: float) -> bool:
    """Return whether the interval of the index stays in one class if it is widened to hold for all verdicts jointly."""
    found = response.verdict
    if found.index is None:
        return False
    # Each of the verdicts may fail only with its part of the error (Bonferroni); the half width of an interval of an
    # index grows with the normal quantile.
    wider = float(ndtri(1 - (1 - confidence) / (2 * judged)) / ndtri(0.5 + confidence / 2))
    low, high = (-math.inf if found.index_low is None else found.index_low, found.index_high or math.inf)
    return not _covers_classes(response, [found.index + wider * (end - found.index) for end in (low, high)])


def _covers_classes(response: ResponseAnalysis, ends: Iterable[float]) -> bool:
    bars = bars_of(response.spec.requirement)
    return len({bars.class_of(end) for end in ends}) > 1


def _open_classes(response: ResponseAnalysis) -> str:
    """Return which other verdicts the interval of Cpk of a response covers, in words."""
    interval = response.capability.cpk_interval or (0.0, 0.0)
    classes = bars_of(response.spec.requirement).classes(interval)
    return f"{response.spec.name} could still be {' or '.join(c for c in classes if c != response.verdict.word)}"


def failures_as_rejects(responses: tuple[ResponseAnalysis, ...], samples: Samples) -> Check:
    """State Cpk and share of rejects if every failed sample is counted as a reject."""
    name = "Failures as rejects"
    if samples.ok.all():
        return Check(name, "good" if samples.ok.size else "info", "No sample failed, so nothing changes.")
    judged = [r for r in responses if r.nonconforming and r.yield_]
    if not judged:
        text = "All samples failed." if not samples.ok.any() else "No response has limits."
        return Check(name, "info", text)
    lowest = sorted(((r.yield_.share, r) for r in judged if r.yield_), key=lambda pair: pair[0])[:FEW]
    each = "; ".join(f"{r.spec.name} {_as_rejects(r)}" for _, r in lowest)
    text = f"If every failed sample were a reject on the worse side (worst response first): {each}."
    return Check(name, "attention", text, lowest[0][0])


def _as_rejects(response: ResponseAnalysis) -> str:
    """Return Cpk and share of rejects of a response, without and with failures counted as rejects."""
    counted, of_yield, cpk = response.nonconforming, response.yield_, response.capability.cpk
    assert counted is not None
    assert of_yield is not None
    shares = f"{format_numbers.ppm(counted.with_failures.ppm)} ppm instead of {format_numbers.ppm(counted.total.ppm)}"
    if of_yield.cpk is None or cpk is None:
        return shares
    return f"Cpk {format_numbers.index(of_yield.cpk)} instead of {format_numbers.index(cpk)}, {shares}"


def limits_in_place(responses: tuple[ResponseAnalysis, ...]) -> tuple[Check, ...]:
    """Name limits on the far side of zero from every value: a wrong sign, or a boundary; empty without such a limit."""
    far = [
        f"{r.spec.name} {key} = {format_numbers.plain(limit)}, values {format_numbers.significant(c.min)} to "
        f"{format_numbers.significant(c.max)}"
        for r in responses
        for c in (r.capability,)
        for key, limit in (("lsl", r.spec.lsl), ("usl", r.spec.usl))
        if limit and c.min is not None and c.max is not None and (c.max < 0 < limit or limit < 0 < c.min)
        if (r.spec.lsl or 0.0) != -(r.spec.usl or 0.0)  # a deviation from a nominal of zero
    ]
    if not far:
        return ()
    text = f"On the far side of zero from every value: {'; '.join(far)}. Is the sign right, or is zero a boundary?"
    return (Check("Limits", "attention", text, float(len(far))),)


def missing_values(responses: tuple[ResponseAnalysis, ...], *, measured: bool = False) -> Check:
    """Check that every ok sample, or measured part, has a number for every response."""
    incomplete = [(r.spec.name, r.missing) for r in responses if r.missing]
    if not incomplete:
        text = "No measurement is missing." if measured else "Every ok sample has a finite number for every response."
        return Check("Values", "good", text, 0.0)
    listed = ", ".join(f"{name} {format_numbers.grouped(count)}" for name, count in incomplete)
    what = "Parts without a measurement" if measured else "Ok samples without a finite number"
    text = f"{what}, left out of the statistics and counted as rejects: {listed}."
    return Check("Values", "attention" if measured else "bad", text, float(sum(count for _, count in incomplete)))


def rare_checks(rare: RareRejects | None) -> tuple[Check, ...]:
    """Return the lines for an importance-sampling campaign; empty for other campaigns."""
    return () if rare is None else (_rare_shares_known(rare), _weights_agree(rare))


def _rare_shares_known(rare: RareRejects) -> Check:
    """Check that the share of every response is supported by its weights."""
    every = (rare, *rare.later)
    name, shares = "Rare rejects", {r.response: r.total for each in every for r in each.responses}
    if not shares:
        return Check(name, "info", "No response has limits.")
    doubts = [f"{response}: {share.doubt}" for response, share in shares.items() if share.doubt]
    if doubts:
        text = f"Only an upper bound is known for {'; '.join(doubts)}. clearcap design uses these runs to aim better."
        return Check(name, "attention", text, float(len(doubts)))
    loose = [
        f"{response} up to {format_numbers.ppm(share.by_chance_ppm)} ppm"
        for response, share in shares.items()
        if share.rejects and share.by_chance_ppm > LOOSE_ALLOWANCE * share.ppm
    ]
    if loose:
        text = (
            f"Further rejects may lie where no component aims: {', '.join(loose)}, which the upper ends of"
            " the intervals include. More runs of a component of scale 2 narrow this; if rejects were found there,"
            " clearcap design aims at them."
        )
        return Check(name, "attention", text, float(len(loose)))
    found = {response: share.standard_error for response, share in shares.items() if share.standard_error is not None}
    none = [response for response in shares if response not in found]
    text = f"Weighted over {format_numbers.grouped(sum(each.runs for each in every))} runs."
    if found:
        widest = max(found, key=found.__getitem__)
        error = format_numbers.percent(found[widest])
        text += f" Shares are known to a standard error of {error} or better (widest: {widest})."
    if none:
        most = format_numbers.ppm(max(shares[response].interval[1] for response in none))
        text += (
            f" No reject of {', '.join(none)} was found: at most {most} ppm by the plain runs alone, and below"
            f" {format_numbers.ppm(rare.unseen_ppm)} ppm if the limit is flat."
        )
    return Check(name, "good", text)


def _weights_agree(rare: RareRejects) -> Check:
    """Check weighted shares against counted shares, and the mean weight against 1."""
    every = (rare, *rare.later)
    checks, plain = [check for each in every for check in each.checks], sum(each.plain for each in every)
    errors = {f"{check.response} {check.side} {check.at:.6g}": abs(check.errors) for check in checks}
    errors["the mean weight and 1"] = max(abs(each.mean_weight_errors) for each in every)
    worst = max(errors, key=errors.__getitem__)
    distance = format_numbers.fixed(errors[worst], 1, (CHECK_BAR,))
    text = (
        f"Weighted shares differ from those counted in the {format_numbers.grouped(plain)} plain runs by at most"
        f" {distance} standard errors, at {len(checks)} limits moved in until both have rejects (largest: {worst})"
    )
    if errors[worst] <= CHECK_BAR:
        return Check("Weights", "good", f"{text}.", errors[worst])
    return Check("Weights", "bad", f"{text}: the weights do not fit the runs.", errors[worst])


# Line of the trust card on normality: which responses are not normal, in which tail, and the effect on the ppm.

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
    # beyond chance even among many responses
    proven = [r for r in shaped if (p := r.normality.anderson_darling_p) is not None and p < PROVEN_P]
    departing = [r for r in shaped if departs(r.normality, len(shaped)) or r in proven]
    rest = [r for r in shaped if r not in departing]
    doubtful = [r for r in rest if (r.normality.p or 0.0) < PERHAPS_P]
    rest = [r for r in rest if r not in doubtful]
    close = [r for r in rest if r.normality.verdict in ("normal", "close to normal")]
    open_ = [r for r in rest if r not in close]
    of_each = [(r, "; ".join(_effects(r))) for r in departing]
    sentences = [f"{r.spec.name} is not normal ({_how(r)}){effects and f': {effects}'}." for r, effects in of_each]
    if close:
        names = _named(close, len(indexed))
        sentences.append(f"{names}: close to normal, no cumulative share is off by more than {_farthest(close)}.")
    if open_:
        smallest = format_numbers.probability(min(r.normality.p for r in open_ if r.normality.p is not None))
        sentences.append(
            f"{_named(open_, len(indexed))}: no departure from normal found (smallest p, tails included, {smallest}), "
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
    misleading = [r for r, effects in of_each if effects or r.normality.verdict == "not normal"]
    level = "attention" if misleading else "info" if open_ or untested or departing or doubtful else "good"
    return Check("Shape", level, " ".join(sentences), float(len(departing)))


def _how(response: ResponseAnalysis) -> str:
    """Return how much a response departs from normal, and in which tail."""
    shape = response.normality
    tails = [tail.words for tail in shape.tails if tail.words]
    where = " and ".join(tails) + " than normal" if tails else "no tail clearly heavier or lighter than normal"
    both = (("Anderson-Darling", shape.anderson_darling_p), ("including the tails", shape.p))
    found = [(name, format_numbers.probability(p)) for name, p in both if p is not None]
    named = [f"{name} p {p if p.startswith('<') else f'= {p}'}" for name, p in found]
    return f"{', '.join(named)}, cumulative shares off by {format_numbers.percent(shape.distance)}, {where}"


def _effects(response: ResponseAnalysis) -> list[str]:
    """Return what tails and count say about the expected ppm, for the sides with a limit."""
    spec, counted, expected = response.spec, response.nonconforming, response.capability.ppm_expected
    limits = {"below": spec.lsl, "above": spec.usl}
    effects = [
        f"the ppm that a normal distribution predicts {tail.side} the limit is too "
        f"{'small' if tail.word == 'heavier' else 'large'}"
        for tail in response.normality.tails
        if tail.words and limits[tail.side] is not None
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
