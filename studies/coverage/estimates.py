"""The estimates of one response, of tolerance intervals, and of a product of two responses.

Of one response they are indices, shares, methods without the normal distribution, and tails.

Each function draws one campaign and yields the report's statements on it.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.stats import multivariate_normal, norm

from reporting.capability.intervals import with_ends
from reporting.capability.shares import nonconforming
from reporting.capability.summary import NOT_NORMAL, capability, target_indices
from reporting.capability.verdict import USUAL, CapabilityVerdict, index_of_share
from reporting.product_yield import product_yield
from reporting.shape.fitting import fit_families
from reporting.shape.nonnormal import NonnormalIndices
from reporting.shape.normality import normality
from reporting.tolerance_intervals import tolerance_intervals
from studies.coverage.outcomes import Statement
from studies.coverage.productions import (
    CONFIDENCE,
    CURVES,
    LIMITS,
    RESPONSE,
    SHARES,
    Production,
    Truth,
    distance_from_normal,
    explained,
    page,
    request,
    samples_of,
    share_below,
    truth,
    warned_of_all,
    warned_of_normal,
)

INFINITE = float("inf")
# Limits as scores, by the class that the share beyond the worse one has.
JUDGED = {"not capable": (-4.5, 2.7), "marginal": (-4.5, 3.6), "capable": (-6.0, 5.0)}
FIRST = 50  # values that are judged first, if they are drawn in turn
CLASSES = ("not capable", "marginal", "capable")
SECOND = "second"
CONTENTS = (0.95, 0.9973)
_WEIGHTS = np.sqrt(SHARES)
# The second response uses the variables of the first one in another order.
_SECOND_WEIGHTS = _WEIGHTS[[2, 0, 1, 3, 4]]


def indices(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of `reporting.capability` that are based on mean and sigma."""
    true, lots = truth(production.shape), production.lot_of(n)
    y = production.draw(n, rng)
    c = capability(y, true.lsl, true.usl, true.target, CONFIDENCE, lots, ordered=False)
    around = target_indices(y, true.lsl, true.usl, true.target, CONFIDENCE, lots)
    assert around is not None
    middle, half = (true.usl + true.lsl) / 2, (true.usl - true.lsl) / 2
    tau = np.hypot(true.std, true.mean - true.target)
    room = min(true.usl - true.target, true.target - true.lsl)
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
        yield Statement(number, interval, float(value))
    if c.within is not None:
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
    (analysed,), card = (found := page(production, production.draw(n, rng), true)).responses, found.trust
    warned, c = warned_of_all(card), analysed.capability
    misleading = warned or warned_of_normal(card) or NOT_NORMAL in c.notes
    yield Statement("Z.bench", c.z_bench_interval, float(norm.isf(1e-6 * true.ppm)), misleading)
    yield Statement("ppm expected, normal", c.ppm_expected_interval, true.ppm, misleading)
    of_method = {m.method: m for m in analysed.methods}
    for name, word in (
        ("percentile", "percentiles, fitted"),
        ("z_score", "Z-scores, fitted"),
        ("empirical", "empirical"),
    ):
        yield from _of_method(word, of_method.get(name), true, warned=warned)
    tails = {tail.side: tail for tail in analysed.tails}
    for side, value in (("below", true.below), ("above", true.above)):
        tail = tails[side]
        yield Statement(f"tail, {side}", tail.interval, value, warned)
    yield Statement(
        "distance from normal", analysed.normality.distance_interval, distance_from_normal(production.shape)
    )
    assert analysed.yield_ is not None
    yield Statement("yield, at least", (analysed.yield_.lower, INFINITE), 1 - 1e-6 * true.ppm, warned)


def _of_method(word: str, m: NonnormalIndices | None, true: Truth, *, warned: bool) -> Iterator[Statement]:
    """Yield the intervals of one method."""
    if word.startswith("Z"):
        ppl, ppu = (float(norm.isf(1e-6 * ppm)) / 3 for ppm in (true.below, true.above))
        pp = (ppl + ppu) / 2
    else:
        ppl = (true.median - true.lsl) / (true.median - true.low)
        ppu = (true.usl - true.median) / (true.high - true.median)
        pp = (true.usl - true.lsl) / (true.high - true.low)
    caution = warned or (m is not None and any("too large" in note for note in m.notes))
    yield Statement(f"Pp, {word}", with_ends(m.pp_interval) if m and m.pp_interval else None, pp, caution)
    yield Statement(f"Ppk, {word}", with_ends(m.ppk_interval) if m and m.ppk_interval else None, min(ppl, ppu), caution)
    if word.startswith("Z"):
        yield Statement("ppm, fitted", m.ppm_expected_interval if m else None, true.ppm, caution)


def verdicts(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the class of a certain verdict, and the true class by the share beyond the worse limit."""
    y = production.draw(n, rng)
    for word, limits in JUDGED.items():
        true = truth(production.shape, limits=limits)
        yield _judged(f"certain verdict, {word}", page(production, y, true).responses[0].verdict, true)


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
    for claim in found.claims:
        if claim.content not in CONTENTS:
            continue
        for kind, between, above, below in (
            ("normal", claim.normal, claim.normal_lower, claim.normal_upper),
            ("any", claim.free, claim.free_lower, claim.free_upper),
        ):
            shares = (
                ("between", None if between is None else _share(production.shape, *between)),
                ("above", None if above is None else _share(production.shape, above, np.inf)),
                ("below", None if below is None else _share(production.shape, -np.inf, below)),
            )
            for side, share in shares:
                claimed = None if share is None else (claim.content, 1.0)
                yield Statement(f"contains {claim.content}, {kind}, {side}", claimed, share or 0.0)


def _share(shape: str, low: float, high: float) -> float:
    """Return the share of a shape's values between two values."""
    return share_below(shape, high) - share_below(shape, low)


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
