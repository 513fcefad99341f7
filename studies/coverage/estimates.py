"""The estimates that the study repeats. Each function draws one campaign and yields the report's statements on it."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np
import pyarrow as pa
from scipy.optimize import brentq
from scipy.stats import multivariate_normal, norm
from scipy.stats.qmc import Sobol

from campaign.coordinator.stopping_rule import judge
from campaign.plan import Plan
from campaign.spec.campaign_file import CampaignSpec
from campaign.store import Store
from engine.arrays import Array
from reporting.analysis import Analysis
from reporting.capability.intervals import with_ends
from reporting.capability.shares import nonconforming
from reporting.capability.summary import NOT_NORMAL, capability, target_indices
from reporting.capability.verdict import USUAL, CapabilityVerdict, index_of_share
from reporting.comparison import compare
from reporting.emulation.emulated_tolerances import NEW_SAMPLES, EmulatedTolerances
from reporting.product_yield import product_yield
from reporting.sensitivity.regression import shapley_values
from reporting.sensitivity.reject_attribution import reject_attribution
from reporting.sensitivity.summary import sensitivity
from reporting.shape.fitting import fit_families
from reporting.shape.nonnormal import NonnormalIndices
from reporting.shape.normality import normality
from reporting.tolerance.advice import Rows, advise
from reporting.tolerance.allocation import CostedVariable, Requirement, allocate
from reporting.tolerance.cost_laws import PowerLaw
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import what_if
from reporting.tolerance_intervals import ToleranceIntervals, tolerance_intervals
from studies.coverage.outcomes import Statement
from studies.coverage.productions import (
    CONFIDENCE,
    RESPONSE,
    SHARES,
    VARIABLES,
    Production,
    first_order,
    page,
    request,
    samples_of,
    warned_of_all,
    warned_of_normal,
)
from studies.coverage.shapes import (
    CURVES,
    LIMITS,
    Truth,
    distance_from_normal,
    explained,
    moments,
    share_within,
    truth,
)

INFINITE = float("inf")
# Limits as scores, by the class that the share beyond the worse one has.
JUDGED = {"not capable": (-4.5, 2.7), "marginal": (-4.5, 3.6), "capable": (-6.0, 5.0)}
FIRST = 50  # values that are judged first, if they are drawn in turn
CLASSES = ("not capable", "marginal", "capable")
SECOND = "second"
CONTENTS = (0.95, 0.9973)
UNSEEN = "a second population"  # that the values may miss
OF_SHAPE = re.compile("Z.bench|ppm|.*fitted|tail")
_WEIGHTS = np.sqrt(SHARES)
# The second response uses the variables of the first one in another order.
_SECOND_WEIGHTS = _WEIGHTS[[2, 0, 1, 3, 4]]


def indices(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of `reporting.capability` that are based on mean and sigma."""
    true, lots = truth(production.shape), production.lot_of(n)
    y = production.draw(n, rng)
    in_order = production.in_order and lots is None
    c = capability(y, true.lsl, true.usl, true.target, CONFIDENCE, lots, ordered=in_order)
    around = target_indices(y, true.lsl, true.usl, true.target, CONFIDENCE, lots)
    assert around is not None
    middle, half = (true.usl + true.lsl) / 2, (true.usl - true.lsl) / 2
    tau = np.hypot(true.std, true.mean - true.target)
    room = min(true.usl - true.target, true.target - true.lsl)
    disordered = c.order is not None and bool(c.order.finding)
    if in_order:
        cautioned = c.order is not None and bool(c.order.unseen)
    else:
        cautioned = any(words in c.interval_reason for words in ("too narrow", "may miss", "cover less"))
    for number, interval, value in (
        ("mean", c.mean_interval, true.mean),
        ("sigma", c.std_interval, true.std),
        ("Cp", c.cp_interval, true.cp),
        ("Cpk", c.cpk_interval, true.cpk),
        ("Cpk, joint", c.cpk_interval_joint, true.cpk),
        ("Cpl", c.cpl_interval, true.cpl),
        ("Cpu", c.cpu_interval, true.cpu),
        ("Cc", c.cc_interval, (true.mean - middle) / half),
        ("Cpm", c.cpm_interval, half / (3 * tau)),
        ("Cpm*", around.cpm_star_interval, room / (3 * tau)),
        ("Cpmk", around.cpmk_interval, true.cpk * true.std / tau),
    ):
        yield Statement(number, interval, float(value), disordered, cautioned)
    if c.within is not None and not production.in_order:
        cp_within = true.cp / np.sqrt(1 - explained(production.shape, production.share_between))
        yield Statement("Cp within lots", c.within.cp_interval, float(cp_within))


def counts(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of counted shares."""
    true = truth(production.shape)
    counted = nonconforming(production.draw(n, rng), true.lsl, true.usl, CONFIDENCE, lots=production.lot_of(n))
    assert counted is not None
    assert counted.below is not None
    assert counted.above is not None
    yield Statement("counted, below", counted.below.interval, true.below)
    yield Statement("counted, above", counted.above.interval, true.above)
    yield Statement("counted, total", counted.total.interval, true.ppm)
    yield Statement("counted, at most", (0.0, counted.total.upper), true.ppm)


def methods(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals based on the shape: shares of a normal distribution, and methods that do without it."""
    true = truth(production.shape)
    yield from _of_page(page(production, production.draw(n, rng), true), production, true)


def _of_page(found: Analysis, production: Production, true: Truth) -> Iterator[Statement]:
    """Yield the intervals of a page that are based on the shape."""
    (analysed,), card = found.responses, found.trust
    warned, c = warned_of_all(card), analysed.capability
    misleading = warned or warned_of_normal(card) or NOT_NORMAL in c.notes
    yield Statement("Z.bench", c.z_bench_interval, float(norm.isf(1e-6 * true.ppm)), misleading)
    yield Statement("ppm expected, normal", c.ppm_expected_interval, true.ppm, misleading)
    of_method = {m.method: m for m in analysed.methods}
    unseen = any(UNSEEN in note for note in analysed.fits.notes)
    for name, word in (
        ("percentile", "percentiles, fitted"),
        ("z_score", "Z-scores, fitted"),
        ("empirical", "empirical"),
    ):
        yield from _of_method(word, of_method.get(name), true, warned=warned, cautioned=unseen)
    tails = {tail.side: tail for tail in analysed.tails}
    for side, value in (("below", true.below), ("above", true.above)):
        tail = tails[side]
        yield Statement(f"tail, {side}", tail.interval, value, warned, unseen)
    yield Statement(
        "distance from normal", analysed.normality.distance_interval, distance_from_normal(production.shape)
    )
    assert analysed.yield_ is not None
    yield Statement("yield, at least", (analysed.yield_.lower, INFINITE), 1 - 1e-6 * true.ppm, warned)


def _of_method(
    word: str, m: NonnormalIndices | None, true: Truth, *, warned: bool, cautioned: bool
) -> Iterator[Statement]:
    """Yield the intervals of one method."""
    if word.startswith("Z"):
        ppl, ppu = (float(norm.isf(1e-6 * ppm)) / 3 for ppm in (true.below, true.above))
        pp = (ppl + ppu) / 2
    else:
        ppl = (true.median - true.lsl) / (true.median - true.low)
        ppu = (true.usl - true.median) / (true.high - true.median)
        pp = (true.usl - true.lsl) / (true.high - true.low)
    caution = warned or (m is not None and any("too large" in note for note in m.notes))
    for number, interval, value in (
        (f"Pp, {word}", m.pp_interval if m else None, pp),
        (f"Ppk, {word}", m.ppk_interval if m else None, min(ppl, ppu)),
    ):
        yield Statement(number, with_ends(interval) if interval else None, value, caution, cautioned)
    if word.startswith("Z"):
        yield Statement("ppm, fitted", m.ppm_expected_interval if m else None, true.ppm, caution, cautioned)


def verdicts(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the class of a certain verdict, and the true class by the share beyond the worse limit."""
    yield from (said for said in pages(production, n, rng) if said.number.startswith("certain"))


def pages(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the class of a certain verdict with limits of each class, and all that the page of a marginal one says."""
    y = production.draw(n, rng)
    for word, limits in JUDGED.items():
        true = truth(production.shape, limits=limits)
        found = page(production, y, true)
        yield _judged(f"certain verdict, {word}", found.responses[0].verdict, true)
        if word == "marginal":
            yield from (said for said in _of_page(found, production, true) if OF_SHAPE.match(said.number))
            assert found.responses[0].tolerance_intervals is not None
            yield from _of_claims(found.responses[0].tolerance_intervals, production)


def verdicts_in_turn(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the first certain verdict on a marginal response of which ever more values are drawn, up to n."""
    true = truth(production.shape, limits=JUDGED["marginal"])
    y, size = production.draw(n, rng), FIRST
    found = page(production, y[:size], true).responses[0].verdict
    while not found.certain and 2 * size <= n:
        size *= 2
        found = page(production, y[:size], true).responses[0].verdict
    yield _judged("certain verdict, in turn", found, true)


def _judged(number: str, found: CapabilityVerdict, true: Truth) -> Statement:
    """Return the class of a verdict as an interval, none if it is not certain, and the true class."""
    given = float(CLASSES.index(found.word)) if found.certain else None
    right = CLASSES.index(USUAL.class_of(index_of_share(max(true.below, true.above))))
    return Statement(number, None if given is None else (given, given), float(right))


def contents(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the share that each tolerance interval claims to contain at least, and the share that it contains."""
    y = production.draw(n, rng)
    found = tolerance_intervals(y, normality(y, CONFIDENCE), fit_families(y), CONFIDENCE, production.lot_of(n))
    yield from _of_claims(found, production)


def _of_claims(found: ToleranceIntervals, production: Production) -> Iterator[Statement]:
    """Yield the share that each tolerance interval claims to contain at least, and the share that it contains."""
    for claim in found.claims:
        if claim.content not in CONTENTS:
            continue
        for kind, between, above, below in (
            ("normal", claim.normal, claim.normal_lower, claim.normal_upper),
            ("any", claim.free, claim.free_lower, claim.free_upper),
        ):
            shares = (
                ("between", None if between is None else share_within(production.shape, *between)),
                ("above", None if above is None else share_within(production.shape, above, np.inf)),
                ("below", None if below is None else share_within(production.shape, -np.inf, below)),
            )
            for side, share in shares:
                claimed = None if share is None else (claim.content, 1.0)
                unseen = kind == "normal" and UNSEEN in found.note
                yield Statement(f"contains {claim.content}, {kind}, {side}", claimed, share or 0.0, cautioned=unseen)


def products(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of the product's yield and of its losses."""
    true = truth(production.shape)
    x = production.variables(n, rng)
    samples = samples_of(production, production.values(x))
    spec = request(production, n, true)
    second = CURVES[production.shape](x @ _SECOND_WEIGHTS)
    samples = replace(samples, values={**samples.values, SECOND: second})
    spec = replace(spec, responses=(*spec.responses, replace(spec.responses[0], name=SECOND)))
    found = product_yield(samples, spec, CONFIDENCE)
    assert found is not None
    assert found.counted is not None
    conforming, loss = product_shares()
    yield Statement("yield of the product", found.counted.interval, conforming)
    yield Statement("yield of the product, at least", (found.counted.lower, np.inf), conforming)
    losses = {part.response: part.share_interval for part in found.losses}
    yield Statement("loss by a response", losses.get(RESPONSE), loss)


@lru_cache(maxsize=1)
def product_shares() -> tuple[float, float]:
    """Return the yield of both responses together, and the part of the rejects due to each of them."""
    correlation = float(_WEIGHTS @ _SECOND_WEIGHTS)
    together = multivariate_normal([0.0, 0.0], [[1.0, correlation], [correlation, 1.0]], abseps=1e-10)
    low, high = LIMITS
    conforming = float(together.cdf([high, high], lower_limit=[low, low]))
    return conforming, (1 - conforming) / 2


# Closer limits than in the other modules, as scores: 2.9 % of the samples are rejects.
NEAR = (-2.5, 2.0)
FACTORS = (0.5, 0.8, 1.3)
OTHER_SPREAD, OTHER_SHIFT = 1.1, 0.2
# Present indices of both sides, and the index to keep.
PRESENT, TARGET = (1.7, 1.5), 1.33


def causes(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of first-order indices."""
    x = production.variables(n, rng)
    (found,) = sensitivity(
        dict(zip(VARIABLES, x.T, strict=True)),
        {RESPONSE: production.values(x)},
        confidence=CONFIDENCE,
        lots=production.lot_of(n),
    ).responses
    warned = any("too narrow" in note for note in found.notes)
    for influence, value in zip(found.influences, first_order(production), strict=True):
        yield Statement(f"first order, {influence.variable}", influence.first_order_interval, value, warned)
    warned |= any("share of interactions: rarer" in note for note in found.notes)
    yield Statement("interactions", found.interaction_interval, 1 - sum(first_order(production)), warned)


def attributions(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of each variable's part of the rejects, which do not depend on the response's shape."""
    x = production.variables(n, rng)
    score = x @ np.sqrt(SHARES)
    rejected = (score < NEAR[0]) | (score > NEAR[1])
    found = reject_attribution(dict(zip(VARIABLES, x.T, strict=True)), rejected, CONFIDENCE, production.lot_of(n))
    intervals = {share.variable: share.interval for share in found.shares}
    for variable, part in zip(VARIABLES, parts(), strict=True):
        yield Statement(f"part of the rejects, {variable}", intervals.get(variable), part)


@lru_cache(maxsize=1)
def parts() -> tuple[float, ...]:
    """Return each variable's Shapley effect on the event that a sample is a reject."""
    # The share explained by a subset of variables is the covariance of the event for two samples that share these
    # variables: two normal scores whose correlation is the subset's part of the variance.
    k = len(SHARES)
    members = np.arange(2**k)[:, None] >> np.arange(k) & 1
    return tuple(shapley_values(np.array([_explained(float(s)) for s in members @ np.array(SHARES)])).tolist())


@lru_cache(maxsize=64)
def _explained(correlation: float) -> float:
    """Return the correlation of the event for two scores with the given correlation."""
    low, high = NEAR
    inside = float(norm.cdf(high) - norm.cdf(low))
    # Two equal scores have no joint density.
    if correlation > 1 - 1e-9:
        return 1.0
    both = multivariate_normal([0.0, 0.0], [[1.0, correlation], [correlation, 1.0]], abseps=1e-11)
    covariance = float(both.cdf([high, high], lower_limit=[low, low])) - inside**2
    return covariance / (inside * (1 - inside))


def changes(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of a response for another sigma of the first variable."""
    now = truth(production.shape)
    x = production.variables(n, rng)
    y = production.values(x)
    for factor in FACTORS:
        change = _change(x[:, 0], factor)
        new = truth(production.shape, _spread(factor))
        found = what_if(y, change, now.lsl, now.usl, CONFIDENCE, production.lot_of(n))
        decided = any("decide" in note for note in found.notes)
        for name, estimate, value, warned in (
            ("mean", found.mean, new.mean, False),
            ("sigma", found.std, new.std, decided),
            ("Cpk", found.cpk, new.cpk, decided),
            ("ppm", found.ppm, new.ppm, False),
        ):
            yield Statement(f"what if {factor}: {name}", None if estimate is None else estimate.interval, value, warned)


def advice(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the interval of the factor by which the sigma of the first variable may grow."""
    x = production.variables(n, rng)
    mean, std = moments(production.shape)
    limits = (mean - 3 * PRESENT[0] * std, mean + 3 * PRESENT[1] * std)

    def widen(_: str, factor: float, rows: Rows) -> Change:
        return _change(x[rows, 0], factor)

    y, lots = production.values(x), production.lot_of(n)
    (found,) = advise(
        {RESPONSE: y},
        {RESPONSE: limits},
        {RESPONSE: TARGET},
        VARIABLES[:1],
        widen,
        CONFIDENCE,
        lots,
        _emulation(x, y, limits) if lots is None else None,
    )
    low, high = found.interval
    given = found.factor is not None and not found.refusal
    interval = (low if low is not None else 0.0, high if high is not None else np.inf)
    yield Statement("advice: factor", interval if given else None, largest_factor(production.shape))


def _emulation(x: Array, y: Array, limits: tuple[float, float]) -> EmulatedTolerances:
    """Return the emulator of the response of rows (n, k), at normal variables with factors on their sigmas."""

    def drawn(factors: Mapping[str, float]) -> Mapping[str, Array]:
        return {name: z * factors.get(name, 1.0) for name, z in zip(VARIABLES, _new_scores().T, strict=True)}

    return EmulatedTolerances(dict(zip(VARIABLES, x.T, strict=True)), {RESPONSE: y}, {RESPONSE: limits}, drawn)


def allocations(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the interval of Cpk where the first variable gets the cheapest, so the widest, sigma that is allowed."""
    x = production.variables(n, rng)
    y = production.values(x)
    mean, std = moments(production.shape)
    limits = (mean - 3 * PRESENT[0] * std, mean + 3 * PRESENT[1] * std)
    share = {VARIABLES[0]: SHARES[0]}
    wanted = Requirement(RESPONSE, float(y.mean()), float(y.std(ddof=1)), *limits, TARGET, share)

    def rescale(factors: Mapping[str, float], rows: Rows) -> Change:
        return _change(x[rows, 0], factors[VARIABLES[0]])

    costed = CostedVariable(VARIABLES[0], 1.0, PowerLaw(0.0, 1.0), 0.1, 10.0)
    found = allocate([costed], [wanted], {RESPONSE: y}, rescale, emulation=_emulation(x, y, limits))
    if not found.responses:
        yield Statement("allocation: Cpk", None, 0.0)
        return
    new_mean, new_std = moments(production.shape, _spread(found.factors[VARIABLES[0]]))
    true = min(new_mean - limits[0], limits[1] - new_mean) / (3 * new_std)
    yield Statement("allocation: Cpk", found.responses[0].cpk_interval, true)


@lru_cache(maxsize=1)
def _new_scores() -> Array:
    """Return standard normal scores of the variables that are spread evenly."""
    points = Sobol(len(VARIABLES), rng=95).random(NEW_SAMPLES)
    return np.asarray(norm.ppf(points))


@lru_cache(maxsize=16)
def largest_factor(shape: str) -> float:
    """Return the factor on the first variable's sigma at which the index of a shape equals the target."""
    mean, std = moments(shape)

    def excess(factor: float) -> float:
        new_mean, new_std = moments(shape, _spread(factor))
        margins = (new_mean - mean + 3 * PRESENT[0] * std, mean + 3 * PRESENT[1] * std - new_mean)
        return min(margins) / (3 * new_std) - TARGET

    return float(brentq(excess, 1.0, 2.0))


def _change(x: Array, factor: float) -> Change:
    """Return the change of the density of a standard normal variable whose sigma is multiplied by a factor."""
    return Change(0.5 * x**2 * (1 - factor**-2) - np.log(factor), spread=factor)


def _spread(factor: float) -> float:
    """Return the sigma of the score if that of the first variable is multiplied by a factor."""
    return float(np.sqrt(1 + SHARES[0] * (factor**2 - 1)))


def differences(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of the comparison with a campaign whose values are shifted and scaled."""
    true = truth(production.shape)
    mine, theirs = production.draw(n, rng), production.draw(n, rng)
    theirs = true.mean + OTHER_SHIFT * true.std + OTHER_SPREAD * (theirs - true.mean)
    spec = request(production, n, true)
    (found,) = compare(samples_of(production, mine), spec, samples_of(production, theirs), spec, CONFIDENCE).responses
    mean, std = true.mean + OTHER_SHIFT * true.std, OTHER_SPREAD * true.std
    cpk = min(mean - true.lsl, true.usl - mean) / (3 * std)
    yield Statement("difference of means", found.mean_interval, true.mean - mean)
    yield Statement("ratio of sigmas", found.std_ratio_interval, true.std / std)
    yield Statement("difference of Cpk", found.cpk_interval, true.cpk - cpk)


# Half widths: of Cpk, and of mean and sigma in sigmas.
HALF_WIDTHS = {"cpk": 0.1, "mean": 0.1, "std": 0.1}


class _Unitless:
    """Stand-in for a mechanism, for a stopping rule: its response is not a length, angle, force or torque."""

    simulation = None

    def response_units(self) -> dict[str, str]:
        """Return the unit of each response."""
        return {RESPONSE: "1"}

    def unit(self, quantity: str) -> str:
        """Return the unit of a quantity."""
        return quantity


@dataclass(frozen=True)
class _Planned:
    """Stand-in for a plan, for a stopping rule."""

    spec: CampaignSpec
    mechanism: "_Unitless"


@dataclass(frozen=True)
class _Rows:
    """Stand-in for the rows of a store, for a stopping rule."""

    values: Array

    def stream(self, plan: object, columns: Sequence[str], *_: object, **__: object) -> Iterator[pa.Table]:
        """Yield all rows as one table."""
        table = pa.table({"sample": np.arange(self.values.size), RESPONSE: self.values})
        yield table.select(list(columns))


def stops(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the interval at the end of a campaign with a stopping rule, after n samples at the latest."""
    true = truth(production.shape)
    rows = _Rows(production.draw(n, rng))
    for statistic, value in (("cpk", true.cpk), ("mean", true.mean), ("std", true.std)):
        planned = _Planned(_spec(production, n, true, statistic), _Unitless())
        rule = planned.spec.stop
        assert rule is not None
        for samples in rule.checkpoints(n):
            verdict = judge(cast(Store, rows), cast(Plan, planned), samples)
            if verdict.sure:
                break
        at_end = (verdict.low, verdict.high) if verdict.low is not None and verdict.high is not None else None
        yield Statement(f"at the stop: {statistic}", at_end if verdict.sure else None, value)


def _spec(production: Production, n: int, true: Truth, statistic: str) -> CampaignSpec:
    """Return a campaign with a stopping rule on the given statistic."""
    half_width = HALF_WIDTHS[statistic] * (1.0 if statistic == "cpk" else true.std)
    variable: dict[str, Any] = {"distribution": "normal", "mean": 0.0, "std": 1.0}
    if production.lots:
        variable["batch"] = {"size": n // production.lots, "std": production.between}
    rule = {"response": RESPONSE, "statistic": statistic, "half_width": half_width, "confidence": CONFIDENCE}
    return CampaignSpec.model_validate(
        {
            "format": 1,
            "name": "study",
            "mechanism": "c60",
            "samples": n,
            "stop": rule,
            "variables": {"X1": variable},
            "responses": {RESPONSE: {"lsl": true.lsl, "usl": true.usl}},
        }
    )
