"""Attribution of the rejects to variables."""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy.stats import multivariate_normal, norm

from reporting.sensitivity.reject_attribution import reject_attribution
from reporting.sensitivity.shapley import shapley_values
from studies.coverage.outcomes import Statement
from studies.coverage.pages import CONFIDENCE
from studies.coverage.productions import SHARES, VARIABLES, Production

# Closer limits than in the other modules, as scores: 2.9 % of the samples are rejects.
NEAR = (-2.5, 2.0)


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
    """Return each variable's Shapley effect on the event that a sample is a reject.

    The share explained by a subset of variables is the covariance of the event for two samples that share these
    variables: two normal scores whose correlation is the subset's part of the variance.
    """
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
