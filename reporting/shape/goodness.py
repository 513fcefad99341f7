"""Whether a fitted distribution may be used: a test of Anderson and Darling by parametric bootstrap, and the tails.

The bootstrap draws samples of n values from the fitted distribution, as counts in cells of its probability, fits each
by one step of Fisher's scoring, and computes its statistic like that of the data. With narrow cells in the tails
nothing of the statistic is lost, and the cost does not depend on n.

No family is exact, so with enough values every one fails. A report requires less: a misfit that is not detectable in
`PRACTICAL` values, and tails that agree with the counted shares.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from scipy.special import betaincinv

from reporting.arrays import Array
from reporting.distributions.families import Scaled, Theta
from reporting.distributions.forms import ClosedForm, Parameter

# A fit with a p-value below this is not used.
LEAST_P = 0.01
# A misfit that is not detectable in this many values is unimportant.
PRACTICAL = 5000
# A tail fails if the counted share is proven (at `_TAIL_CHANCE`) to differ by more than this factor.
TAIL_FACTOR = 1.5
_TAIL_CHANCE = 0.002
# Shares at which the tails are compared, besides the limits; smaller expected counts than the last are not compared.
TAIL_SHARES, _FEWEST_EXPECTED = (0.00135, 0.01), 3.0
_RESAMPLES = 999
# Fixed, so that the same values always give the same report.
_SEED = 19540
# Directions with less information than this part of the largest are not treated as fitted.
_FLATTEST = 1e-7
_STEP = 1e-4


class Bootstrap:
    """Resamples of n values as counts in cells of equal probability, narrower in the tails."""

    def __init__(self, n: int) -> None:
        # Of up to 12 values a quarter of one is more than 2 %: there are no narrower cells.
        tail = np.geomspace(0.25 / n, 0.02, 16)[:-1] if n > 12 else np.empty(0)
        self.n = n
        self.edges = np.concatenate((tail, np.linspace(0.02, 0.98, 49), 1 - tail[::-1]))
        self.cells = np.diff(np.concatenate(([0.0], self.edges, [1.0])))
        counts = np.random.default_rng(_SEED).multinomial(n, self.cells, size=_RESAMPLES)
        self.excess = counts / n - self.cells
        # A^2 is n times the integral of (F_n - F)^2 / (F (1 - F)) over F: here a sum over the edges.
        self.weights = (self.cells[:-1] + self.cells[1:]) / 2 / (self.edges * (1 - self.edges))

    def p_value(self, build: Callable[[Sequence[Parameter]], ClosedForm], theta: Theta, statistic: float) -> float:
        """Return the share of resamples that are at least as far from their own fit as the data are from theirs.

        `statistic` is A^2 of the data. With more than `PRACTICAL` values, its excess over the expected value is scaled
        to `PRACTICAL` values.
        """
        slopes = self._slopes(build, theta)
        of_cells = np.diff(slopes, axis=0, prepend=0.0, append=0.0) / self.cells[:, None]
        information = of_cells.T @ (self.cells[:, None] * of_cells)
        steepness, axes = np.linalg.eigh(information)
        known = steepness > _FLATTEST * steepness[-1]
        inverse = (axes[:, known] / steepness[known]) @ axes[:, known].T
        fitted = self.excess @ of_cells @ inverse
        deviation = np.cumsum(self.excess, axis=1)[:, :-1] - fitted @ slopes.T
        drawn = self.n * (deviation**2 @ self.weights)
        usual = float(np.mean(drawn))
        practical = usual + (statistic - usual) * min(1.0, PRACTICAL / self.n)
        # The data count as one more sample: 999 of them cannot prove a p-value below 1 in 1,000.
        return float((1 + np.count_nonzero(drawn >= practical)) / (1 + _RESAMPLES))

    def _slopes(self, build: Callable[[Sequence[Parameter]], ClosedForm], theta: Theta) -> Array:
        """Return the derivatives of the distribution function at the edges by each parameter, shape (edges, k)."""
        at = build(theta).ppf(self.edges)
        centre = np.asarray(theta)
        steps = np.diag(_STEP * (1 + np.abs(centre)))
        up, down = (build(list((centre + sign * steps).T[:, :, None])) for sign in (1, -1))
        lower = up.cdf(at) - down.cdf(at)
        upper = down.sf(at) - up.sf(at)
        # Differences of the smaller of the two shares: those of a share near 1 lose all digits in the tail.
        slopes = np.where(self.edges < 0.5, lower, upper).T / (2 * np.diag(steps))
        return np.where(np.isfinite(slopes), slopes, 0.0)


@lru_cache(maxsize=2)
def bootstrap(n: int) -> Bootstrap:
    """Return the resamples of n values; those of the latest sizes are cached for the other responses of a report."""
    return Bootstrap(n)


def tail_misfit(ordered: Array, fitted: Scaled, limits: Sequence[float | None]) -> str:
    """Return where a counted share of ascending values contradicts the fitted distribution; empty if none does."""
    n = int(ordered.size)
    shares = [share for share in TAIL_SHARES if share * n >= _FEWEST_EXPECTED]
    lows = [(float(fitted.ppf(share)), share, f"below its {100 * share:g} % quantile") for share in shares]
    highs = [(float(fitted.ppf(1 - share)), share, f"above its {100 - 100 * share:g} % quantile") for share in shares]
    lower, upper = limits
    if lower is not None:
        lows.append((lower, float(fitted.cdf(lower)), "below the lower limit"))
    if upper is not None:
        highs.append((upper, float(fitted.sf(upper)), "above the upper limit"))
    counted = [(int(np.searchsorted(ordered, at, side="left")), share, where) for at, share, where in lows]
    counted += [(n - int(np.searchsorted(ordered, at, side="right")), share, where) for at, share, where in highs]
    for count, share, where in counted:
        low = float(betaincinv(count, n - count + 1, _TAIL_CHANCE / 2)) if count else 0.0
        high = float(betaincinv(count + 1, n - count, 1 - _TAIL_CHANCE / 2)) if count < n else 1.0
        if low > TAIL_FACTOR * share or high < share / TAIL_FACTOR:
            return f"{where} it expects {n * share:.3g} values, and there are {count}"
    return ""
