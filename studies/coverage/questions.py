"""What moves the response, what if a variable varied more or less, and how two campaigns differ."""

from collections.abc import Iterator

import numpy as np

from reporting.comparison import compare
from reporting.sensitivity.summary import sensitivity
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import Estimate, what_if
from studies.coverage.outcomes import Statement
from studies.coverage.pages import CONFIDENCE, RESPONSE, request, samples_of
from studies.coverage.productions import SHARES, VARIABLES, Production, first_order, truth

FACTORS = (0.5, 0.8, 1.3)
OTHER_SPREAD, OTHER_SHIFT = 1.1, 0.2


def causes(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of first-order indices."""
    true = truth(production.shape)
    x = production.variables(n, rng)
    found = sensitivity(
        dict(zip(VARIABLES, x.T, strict=True)),
        {RESPONSE: production.values(x)},
        {RESPONSE: (true.lsl, true.usl)},
        confidence=CONFIDENCE,
    ).responses[0]
    for influence, value in zip(found.influences, first_order(production), strict=True):
        yield Statement(f"first order, {influence.variable}", influence.first_order_interval, value)


def changes(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of a response under another sigma of the first variable."""
    now = truth(production.shape)
    x = production.variables(n, rng)
    y = production.values(x)
    for factor in FACTORS:
        change = Change(0.5 * x[:, 0] ** 2 * (1 - factor**-2) - np.log(factor))
        new = truth(production.shape, float(np.sqrt(1 + SHARES[0] * (factor**2 - 1))))
        found = what_if(y, change, now.lsl, now.usl, CONFIDENCE, production.lot_of(n))
        decided = any("decide" in note for note in found.notes)
        for name, estimate, value, warned in (
            ("mean", found.mean, new.mean, False),
            ("sigma", found.std, new.std, decided),
            ("Cpk", found.cpk, new.cpk, decided),
            ("ppm", found.ppm, new.ppm, False),
        ):
            yield Statement(f"what if {factor}: {name}", _interval(estimate), value, warned)


def _interval(estimate: Estimate | None) -> tuple[float, float] | None:
    """Return the interval of a reweighted number."""
    return None if estimate is None else estimate.interval


def differences(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of the comparison with a campaign whose values are shifted and spread."""
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
