"""The yield of a product of two responses, the loss by each response, and tolerance intervals."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.stats import multivariate_normal

from reporting.content.tolerance_intervals import tolerance_intervals
from reporting.product.product_yield import product_yield
from reporting.shape.normality import normality
from studies.coverage.outcomes import Statement
from studies.coverage.pages import CONFIDENCE, RESPONSE, request, samples_of
from studies.coverage.productions import CURVES, LIMITS, SHARES, Production, share_below, truth

SECOND = "second"
CONTENTS = (0.95, 0.9973)
_WEIGHTS = np.sqrt(SHARES)
# The second response uses the variables of the first one in another order.
_SECOND_WEIGHTS = _WEIGHTS[[2, 0, 1, 3, 4]]


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
    conforming, loss = shares()
    yield Statement("yield of the product", found.counted.interval, conforming)
    yield Statement("yield of the product, at least", (found.counted.lower, np.inf), conforming)
    losses = {part.response: part.share_interval for part in found.losses}
    yield Statement("loss by a response", losses.get(RESPONSE), loss)


@lru_cache(maxsize=1)
def shares() -> tuple[float, float]:
    """Return the yield of both responses together, and the part of the rejects due to each of them."""
    correlation = float(_WEIGHTS @ _SECOND_WEIGHTS)
    together = multivariate_normal([0.0, 0.0], [[1.0, correlation], [correlation, 1.0]], abseps=1e-10)
    low, high = LIMITS
    conforming = float(together.cdf([high, high], lower_limit=[low, low]))
    return conforming, (1 - conforming) / 2


def contents(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the share that each tolerance interval claims to contain at least, and the share that it contains."""
    y = production.draw(n, rng)
    found = tolerance_intervals(y, normality(y, CONFIDENCE), CONFIDENCE, production.lot_of(n))
    for claim in found.claims:
        if claim.content not in CONTENTS:
            continue
        cautioned = "contains less" in found.note
        for kind, between, above, below, warned in (
            ("normal", claim.normal, claim.normal_lower, claim.normal_upper, cautioned),
            ("any", claim.free, claim.free_lower, claim.free_upper, False),
        ):
            shares = (
                ("between", None if between is None else _share(production.shape, *between)),
                ("above", None if above is None else _share(production.shape, above, np.inf)),
                ("below", None if below is None else _share(production.shape, -np.inf, below)),
            )
            for side, share in shares:
                said = None if share is None else (claim.content, 1.0)
                yield Statement(f"contains {claim.content}, {kind}, {side}", said, share or 0.0, warned)


def _share(shape: str, low: float, high: float) -> float:
    """Return the share of a shape's values between two values."""
    return share_below(shape, high) - share_below(shape, low)
