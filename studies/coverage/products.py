"""The yield of a product of two responses that share their variables, and what each response costs of it."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.stats import multivariate_normal

from reporting.product.product_yield import product_yield
from studies.coverage.outcomes import Statement
from studies.coverage.pages import CONFIDENCE, RESPONSE, request, samples_of
from studies.coverage.productions import CURVES, LIMITS, SHARES, Production, truth

SECOND = "second"
_WEIGHTS = np.sqrt(SHARES)
# The second response has the first one's variables in another order.
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
    """Return the yield of both responses together, and the part of the rejects that is due to each of them."""
    correlation = float(_WEIGHTS @ _SECOND_WEIGHTS)
    together = multivariate_normal([0.0, 0.0], [[1.0, correlation], [correlation, 1.0]], abseps=1e-10)
    low, high = LIMITS
    conforming = float(together.cdf([high, high], lower_limit=[low, low]))
    return conforming, (1 - conforming) / 2
