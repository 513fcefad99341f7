"""Whether a fitted distribution may be used: a test of Anderson and Darling by parametric bootstrap, and the tails.

The bootstrap draws samples of n from the fitted distribution, as counts in cells of its probability, fits each by one
step of Fisher's scoring and measures it as the data were measured. Cells that are narrow in the tails lose nothing of
the statistic, and the cost does not depend on n.

No family is exact, so with enough values every one fails. What a report needs is less: a misfit that would not show in
`PRACTICAL` values, and tails that agree with the counted shares.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from scipy.special import betaincinv

from reporting.arrays import Array
from reporting.shape.family.distributions import ClosedForm, Parameter
from reporting.shape.family.families import Scaled, Theta

# A fit with a smaller p-value is not used.
LEAST_P = 0.01
# A misfit that this many values would not show is unimportant.
PRACTICAL = 5000
# A tail fails if the counted share is proven (at `_TAIL_CHANCE`) to differ by more than this factor.
TAIL_FACTOR = 1.5
_TAIL_CHANCE = 0.002
# Shares where the tails are compared, besides those at the limits; expected counts below the last are not.
TAIL_SHARES, _FEWEST_EXPECTED = (0.00135, 0.01), 3.0
_RESAMPLES = 999
# Fixed, so that the same values always give the same report.
_SEED = 19540
# Directions in which the values carry less information than this part of the largest do not count as fitted.
_FLATTEST = 1e-7
_STEP = 1e-4


class Bootstrap:
    """Resamples of n values as counts in cells of equal probability, narrower in the tails.

    Parameters
    ----------
    n : int
        Size of a sample.
    """

    def __init__(self, n: int) -> None:
        tail = np.geomspace(0.25 / n, 0.02, 16)[:-1] if n > 12 else np.empty(0)
        self.n = n
        self.edges = np.concatenate((tail, np.linspace(0.02, 0.98, 49), 1 - tail[::-1]))
        self.cells = np.diff(np.concatenate(([0.0], self.edges, [1.0])))
        counts = np.random.default_rng(_SEED).multinomial(n, self.cells, size=_RESAMPLES)
        self.excess = counts / n - self.cells
        self.weights = (self.cells[:-1] + self.cells[1:]) / 2 / (self.edges * (1 - self.edges))

    def p_value(self, build: Callable[[Sequence[Parameter]], ClosedForm], theta: Theta, statistic: float) -> float:
        """Return the share of resamples, each with its own fit, that are as far from their fit as the data.

        Parameters
        ----------
        build : callable
            From parameters to the distribution.
        theta : tuple of float
            The fitted parameters.
        statistic : float
            A^2 of the data. With more than `PRACTICAL` values the part beyond its mean by chance is reduced to that
            of so many values.
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
        return float((1 + np.count_nonzero(drawn >= practical)) / (1 + _RESAMPLES))

    def _slopes(self, build: Callable[[Sequence[Parameter]], ClosedForm], theta: Theta) -> Array:
        """Return the derivatives of the distribution function at the edges by each parameter, shape (edges, k)."""
        at = build(theta).ppf(self.edges)
        centre = np.asarray(theta)
        steps = np.diag(_STEP * (1 + np.abs(centre)))
        up, down = (build(list((centre + sign * steps).T[:, :, None])) for sign in (1, -1))
        lower = up.cdf(at) - down.cdf(at)
        upper = down.sf(at) - up.sf(at)
        slopes = np.where(self.edges < 0.5, lower, upper).T / (2 * np.diag(steps))
        return np.where(np.isfinite(slopes), slopes, 0.0)


@lru_cache(maxsize=2)
def bootstrap(n: int) -> Bootstrap:
    """Return the resamples of n values; those of the last sizes are kept for the other responses of a report."""
    return Bootstrap(n)


def tail_misfit(ordered: Array, fitted: Scaled, limits: Sequence[float | None]) -> str:
    """Return where a counted share contradicts the fitted distribution; empty if none does.

    Parameters
    ----------
    ordered : array, shape (n,)
        Ascending values.
    fitted : Scaled
        In the unit of the values.
    limits : (float or None, float or None)
        The lower and the upper limit.
    """
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
