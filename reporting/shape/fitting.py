"""Distributions fitted to a response: all families, those that may be used, and the chosen one.

A family may be used if it passes a test of its fit (by parametric bootstrap). Among these, the family with the
smallest AIC is considered no better than a simpler one within `AIC_MARGIN`. The data do not rule out the families
within `AIC_SUPPORT`, so statements on the tails must be valid for all of them.

Each family is fitted by maximum likelihood. The search uses the sample binned to 600 values, the goodness of fit
4,000 (`reporting.shape.sorted_sample`), so a million values cost as much as a few thousand. Normal and lognormal
distributions use the moments of all values; sigma has the divisor n - 1, as everywhere in the report.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting.arrays import PIECE, ROUNDING, Array, standard_deviation, sums
from reporting.capability.intervals import share_interval
from reporting.distributions.families import FAMILIES, Family, Scaled, Theta
from reporting.distributions.forms import ClosedForm, Parameter
from reporting.shape.sorted_sample import (
    Atom,
    BinnedSample,
    SortedSample,
    anderson_darling,
    bin_sample,
    distance,
    sorted_sample,
)

# Maximisation of a likelihood of a few unconstrained parameters, and the covariance of the estimates.
#
# A damped Newton method with finite differences is used instead of `scipy.optimize` on purpose. Some families have no
# maximum: their likelihood rises towards a limit, as Johnson's families do for normal values. In that case this search
# stops after 50 bounded steps. scipy's BFGS and trust-region methods need two to four times as many evaluations, or
# stop earlier on the same slope; for a regular maximum the log-likelihoods agree to 1e-3 or better. All points that a
# step needs are evaluated at once.

Likelihood = Callable[[Array], Array]

# Step of a central difference that balances rounding and curvature of a log-likelihood.
_STEP = 1e-4
_ITERATIONS, _HALVINGS = 50, 30
# Step lengths tried at the same time.
_AT_ONCE = 6
# Parameters are logarithms or of order one: a longer step leaves the range where the curvature is valid.
_LONGEST = 2.0
# The search ends when the expected gain of a step in log-likelihood is smaller.
_CLIMB = 1e-9
# Curvatures below this share of the largest are raised to this share.
_FLATTEST_CURVATURE = 1e-9


def maximise(loglik: Likelihood, start: Theta) -> Theta | None:
    """Return the maximiser of `loglik`, a function of points, shape (p, k); None if it is not finite at `start`.

    Newton's method: where the likelihood is not concave, the magnitudes of the curvatures are used; a step is halved
    until the likelihood rises.
    """
    theta = np.asarray(start, dtype=np.float64)
    best = float(loglik(theta[None])[0])
    if not math.isfinite(best):
        return None
    for _ in range(_ITERATIONS):
        gradient, hessian = _derivatives(loglik, theta, best)
        if not (np.all(np.isfinite(gradient)) and np.all(np.isfinite(hessian))):
            break
        step = _ascent(gradient, hessian)
        if float(gradient @ step) < _CLIMB:
            break
        theta, value = _line_search(loglik, theta, best, step)
        if not value > best:
            break
        best = value
    return tuple(theta.tolist())


def curvature(loglik: Likelihood, theta: Theta) -> Array | None:
    """Return the negative second derivatives at the maximum; None where they are not finite."""
    point = np.asarray(theta, dtype=np.float64)
    _, hessian = _derivatives(loglik, point, float(loglik(point[None])[0]))
    return -hessian if np.all(np.isfinite(hessian)) else None


def covariance(information: Array | None) -> tuple[tuple[float, ...], ...] | None:
    """Return the inverse of the negative second derivatives; None where they are not positive definite."""
    if information is None:
        return None
    steepness, axes = np.linalg.eigh(information)
    if steepness[0] <= _FLATTEST_CURVATURE * steepness[-1]:
        return None
    return tuple(tuple(row) for row in ((axes / steepness) @ axes.T).tolist())


def _ascent(gradient: Array, hessian: Array) -> Array:
    """Return Newton's step, uphill in every direction, with no component above `_LONGEST`."""
    steepness, axes = np.linalg.eigh(-hessian)
    steepness = np.abs(steepness)
    steepness = np.maximum(steepness, _FLATTEST_CURVATURE * float(np.max(steepness)) + 1e-300)
    step = axes @ ((axes.T @ gradient) / steepness)
    longest = float(np.max(np.abs(step)))
    return np.asarray(step * min(1.0, _LONGEST / longest) if longest > 0 else step)


def _line_search(loglik: Likelihood, theta: Array, best: float, step: Array) -> tuple[Array, float]:
    """Return the first point better than `best` as `step` is halved, or `theta` itself."""
    for first in range(0, _HALVINGS, _AT_ONCE):
        points = theta + step * 0.5 ** np.arange(first, first + _AT_ONCE)[:, None]
        values = loglik(points)
        better = np.flatnonzero(values > best)
        if better.size:
            return points[better[0]], float(values[better[0]])
    return theta, best


def _derivatives(loglik: Likelihood, centre: Array, middle: float) -> tuple[Array, Array]:
    """Return the gradient and the second derivatives by central differences."""
    k = centre.size
    step = _STEP * (1 + np.abs(centre))
    ahead = np.diag(step)
    first, second = _pairs(k)
    mixed = [centre + a * ahead[first] + b * ahead[second] for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    values = loglik(np.concatenate((centre + ahead, centre - ahead, *mixed)))
    up, down = values[:k], values[k : 2 * k]
    corners = values[2 * k :].reshape(4, -1)
    hessian = np.diag((up - 2 * middle + down) / step**2)
    hessian[first, second] = (corners[0] - corners[1] - corners[2] + corners[3]) / (4 * step[first] * step[second])
    hessian[second, first] = hessian[first, second]
    return (up - down) / (2 * step), hessian


@cache
def _pairs(k: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the index pairs of k parameters, the later one first; cached, as finding them outlasts a likelihood."""
    return np.tril_indices(k, -1)


# Whether a fitted distribution may be used: a test of Anderson and Darling by parametric bootstrap, and the tails.
#
# The bootstrap draws samples of n values from the fitted distribution, as counts in cells of its probability, fits each
# by one step of Fisher's scoring, and computes its statistic like that of the data. With narrow cells in the tails
# nothing of the statistic is lost, and the cost does not depend on n.
#
# No family is exact, so with enough values every one fails. A report requires less: a misfit that is not detectable in
# `PRACTICAL` values, and tails that agree with the counted shares.

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
        """Return the share of resamples that are at least as far from their fit as the data, with this A^2, are.

        With more than `PRACTICAL` values the excess of A^2 over its expected value is scaled to so many values.
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
        low, high = share_interval(count, n, 1 - _TAIL_CHANCE)
        if low > TAIL_FACTOR * share or high < share / TAIL_FACTOR:
            return f"{where} it expects {n * share:.3g} values, and there are {count}"
    return ""


SEARCHED, JUDGED = 600, 4000
# Values needed for each parameter.
VALUES_PER_PARAMETER = 8
# Below this ratio of sigma to value a family that starts at zero is indistinguishable from a normal distribution.
LEAST_VARIATION = 0.01
# A mixture component narrower than a quarter of the shortest range that contains this share of the values is a spike.
_SPIKE_SHARE, _FEWEST_IN_SPIKE = 0.05, 8
# With a threshold closer to the extreme value, in mean distances of values, the likelihood has no maximum.
_CLOSEST = 0.01
# Burnham, Anderson (2002): a family within 2 of the smallest AIC has substantial support.
AIC_MARGIN = 2.0
# Up to this difference the values do not rule out a family: the 95 % point of chi-square plus the margin.
AIC_SUPPORT = 3.84 + AIC_MARGIN


@dataclass(frozen=True)
class Fit:
    """A family fitted to the values."""

    family: str  # key in `reporting.distributions.families.FAMILIES`
    title: str  # the name in words
    # In the unit of the values. Those of a power transformation refer to ``(x - shift) /
    # scale``; shift and scale are then included.
    parameters: dict[str, float]
    theta: Theta  # unconstrained parameters, which with shift and scale determine the distribution (see `distribution`)
    # of theta, from the curvature of the likelihood; None where it is flat
    covariance: tuple[tuple[float, ...], ...] | None
    shift: float  # in the unit of the values, like the scale
    scale: float
    n: int  # number of values
    loglik: float  # with the density in 1/unit
    aic: float  # Akaike's information criterion
    bic: float  # Schwarz's information criterion
    ad: float | None  # Anderson-Darling statistic. It grows with n: it ranks families but does not measure a misfit.
    # p-value of `ad` by parametric bootstrap, with the parameters fitted to each resample; above 5,000 values, that of
    # the misfit scaled to 5,000 values. None if a value is impossible under the fit.
    ad_p: float | None
    distance: float  # Kolmogorov's, between sample and distribution: the size of the misfit
    passes: bool  # whether it may be used: the p-value is at least 0.01 and no counted share contradicts the tails
    misfit: str  # why it may not be used; else empty


@dataclass(frozen=True)
class Fits:
    """All families fitted to a response."""

    fits: tuple[Fit, ...]  # in ascending order of AIC
    # Chosen family: the one with the fewest parameters among those that pass and are within `AIC_MARGIN` of the
    # smallest AIC; among several, the normal one. None if no family passes.
    best: str | None
    # Families that pass and that the data do not rule out, by AIC. Differences of AIC are scaled to those of
    # `PRACTICAL` values.
    candidates: tuple[str, ...]
    atoms: tuple[Atom, ...]  # of the values; if there are any, no family is fitted
    refused: dict[str, str]  # families that were not fitted, with the reason
    notes: tuple[str, ...]  # how the families were fitted, or why none was fitted or is used

    def of(self, family: str | None) -> Fit | None:
        """Return the fit of a family; None if there is none."""
        return next((fit for fit in self.fits if fit.family == family), None)


def fit_families(
    x: ArrayLike | SortedSample,
    names: Iterable[str] | None = None,
    limits: Sequence[float | None] = (None, None),
) -> Fits:
    """Fit every family, or those named, to finite values; at `limits` tails are compared."""
    sample = sorted_sample(x)
    values, n = sample.values, int(sample.values.size)
    largest = float(max(abs(values[0]), abs(values[-1]))) if n else 0.0
    if n < 2 or values[-1] - values[0] <= ROUNDING * largest:
        return unfitted("Fewer than two different values, so no distribution is fitted.")
    # The square of a double above 1e154 overflows, a sum of squares earlier.
    if not largest < 1e150 or not standard_deviation(values) > 0:
        return unfitted("The values are too large or too small to be squared, so no distribution is fitted.")
    tied = sample.repetition
    found = tied.atoms
    if found:
        reasons = [atom.words for atom in found]
        return unfitted(" ".join([*reasons, "No smooth distribution describes that, so none is fitted."]), found)
    if tied.discrete:
        return unfitted(f"Only {tied.distinct} different values, so no smooth distribution is fitted.")
    fitting = Fitting(sample, limits)
    families = FAMILIES.values() if names is None else [FAMILIES[name] for name in FAMILIES if name in set(names)]
    outcomes = {family.name: fitting.fit(family) for family in families}
    fits = sorted((fit for fit in outcomes.values() if isinstance(fit, Fit)), key=lambda fit: fit.aic)
    refused = {name: reason for name, reason in outcomes.items() if isinstance(reason, str)}
    passing = [fit for fit in fits if fit.passes]
    notes: tuple[str, ...] = ()
    if n > SEARCHED:
        notes = (f"Fitted to {SEARCHED} weighted values that represent {n}; both tails are complete.",)
    if tied.distinct < n:
        notes += (
            "Equal values are spread over the interval that rounds to them: parameters and ppm differ a little from "
            "those of programs that fit rounded values as they are.",
        )
    if fits and not passing:
        notes += (f"No family is used: of {len(fits)} fitted, none agrees with the values.",)
    close = [fit for fit in passing if fit.aic <= passing[0].aic + AIC_MARGIN]
    best = min(close, key=lambda fit: (len(fit.theta), fit.family != "normal", fit.aic)).family if close else None
    candidates = tuple(fit.family for fit in passing if handicap(fit, passing) <= AIC_SUPPORT)
    return Fits(tuple(fits), best, candidates, (), refused, notes)


def unfitted(reason: str, found: tuple[Atom, ...] = ()) -> Fits:
    """Return a result without fits, with the reason."""
    return Fits((), None, (), found, {}, (reason,))


def handicap(fit: Fit, fits: Sequence[Fit]) -> float:
    """Return how far AIC is above that of the best of `fits` that passes, their first; scaled to `PRACTICAL` values."""
    least = next(each.aic for each in fits if each.passes)
    return (fit.aic - least) * min(1.0, PRACTICAL / fit.n)


class Fitting:
    """The ascending values of a response, shape (n,), ready for many families."""

    def __init__(self, sample: SortedSample, limits: Sequence[float | None]) -> None:
        self.ordered, self.limits = sample.values, limits
        ordered, self.smooth = sample.values, sample.spread
        self.few, self.many = bin_sample(self.smooth, SEARCHED), bin_sample(self.smooth, JUDGED)
        self.bootstrap = bootstrap(ordered.size)
        self.median, self.std = sample.location["median"], standard_deviation(ordered)
        mean = sums(ordered, lambda piece: (piece - self.median,))[0] / ordered.size / self.std

        def cubes(piece: Array) -> tuple[Array]:
            z = (piece - self.median) / self.std - mean
            return (z * z * z,)

        self.skewness = sums(ordered, cubes)[0] / ordered.size

    def fit(self, family: Family) -> Fit | str:
        """Return the fit of a family, or why there is none."""
        n, k = int(self.ordered.size), len(family.parameters)
        if n < VALUES_PER_PARAMETER * k:
            return f"{n} values are too few for {k} parameters; {VALUES_PER_PARAMETER * k} are needed"
        frame = self._frame(family)
        if isinstance(frame, str):
            return frame
        shift, scale = frame
        loglik = log_likelihood(family, self.few.scaled(shift, scale))
        many = self.many.scaled(shift, scale)
        with np.errstate(all="ignore"):  # a search may pass through parameters whose likelihood overflows
            theta: Theta | None = self._moments(family, shift, scale)
            if theta is None:
                theta = maximise(loglik, family.start((self.few.values - shift) / scale, self.few.weights))
            if theta is None:
                return "no maximum of the likelihood was found"
            parameters = family.in_units(theta, shift, scale)
            spike = self._spike(parameters)
            if spike:
                return spike
            fitted = Scaled(family.build(theta), shift, scale)
            total = float(many.weights @ fitted.base.logpdf(many.values)) - n * math.log(abs(scale))
            cdf, sf = fitted.base.cdf(many.values), fitted.base.sf(many.values)
            if not math.isfinite(total) or not np.all(np.isfinite(cdf)):
                return "some values are impossible under the distribution that fits the others"
            ad = anderson_darling(self.many, cdf, sf) if scale > 0 else anderson_darling(self.many, sf, cdf)
            ad_p = None if ad is None else self.bootstrap.p_value(family.build, theta, ad)
            # of the body of the values, else of the tails
            misfit = "an extreme value is impossible" if ad_p is None else ""
            misfit = misfit or (f"Anderson-Darling p = {ad_p:.2g}" if ad_p is not None and ad_p < LEAST_P else "")
            misfit = misfit or tail_misfit(self.ordered, fitted, self.limits)
            information = curvature(loglik, theta)
        return Fit(
            family=family.name,
            title=family.title,
            parameters=parameters,
            theta=theta,
            covariance=covariance(information),
            shift=shift,
            scale=scale,
            n=n,
            loglik=total,
            aic=2 * k - 2 * total,
            bic=k * math.log(n) - 2 * total,
            ad=ad,
            ad_p=ad_p,
            distance=distance(self.many, cdf if scale > 0 else sf),
            passes=not misfit,
            misfit=misfit,
        )

    def _frame(self, family: Family) -> tuple[float, float] | str:
        """Return shift and scale of a family, or why it cannot describe the values."""
        low, high = float(self.smooth[0]), float(self.smooth[-1])
        if family.frame == "positive":
            if low <= 0:
                return f"values at or below 0 (smallest {low:.6g}); the family has only positive ones"
            if self.std < LEAST_VARIATION * high:
                return f"zero is more than {1 / LEAST_VARIATION:.0f} sigma away: too far for a positive family"
            return 0.0, self.median
        sign = -1.0 if family.frame.endswith("mirrored") else 1.0
        if family.frame.startswith("free"):
            return self.median, sign * self.std
        if family.frame.startswith("skewed") and sign * self.skewness < 0:
            return "the values are skewed the other way"
        half = (high - low) / 2
        return low + half, sign * half

    def _moments(self, family: Family, shift: float, scale: float) -> Theta | None:
        """Return theta of the families that moments determine, from all values; None for other families."""
        if family.name not in ("normal", "lognormal"):
            return None

        def scores(piece: Array) -> Array:
            z = (piece - shift) / scale
            return np.log(z) if family.name == "lognormal" else z

        n = self.ordered.size
        mean = sums(self.ordered, lambda piece: (scores(piece),))[0] / n
        square = sums(self.ordered, lambda piece: (np.square(scores(piece) - mean),))[0] / (n - 1)
        return mean, math.log(math.sqrt(square))

    @cached_property
    def _narrowest(self) -> float:
        """Sigma below which a component of a mixture is a spike."""
        x, among = self.smooth, max(_FEWEST_IN_SPIKE, int(_SPIKE_SHARE * self.smooth.size))
        ends = [x[at : at + PIECE] for at in range(among, x.size, PIECE)]
        ranges = [float(np.min(end - x[k * PIECE : k * PIECE + end.size])) for k, end in enumerate(ends)]
        return min(ranges, default=0.0) / 4

    def _spike(self, parameters: dict[str, float]) -> str:
        """Return why the fit describes a few values instead of all; empty if it does not."""
        x, n = self.smooth, self.smooth.size
        if any(parameters.get(name, math.inf) < self._narrowest for name in ("sd 1", "sd 2")):
            return "one of the two distributions would be a spike at a few values"
        closest = _CLOSEST * float(x[-1] - x[0]) / n
        if x[0] - parameters.get("low", -math.inf) < closest or parameters.get("high", math.inf) - x[-1] < closest:
            return "the likelihood has no maximum: it grows as a threshold approaches the extreme value"
        return ""


def log_likelihood(family: Family, sample: BinnedSample) -> Callable[[Array], Array]:
    """Return the log-likelihood of a sample of z as a function of parameters, shape (p, k), for p of them."""

    def loglik(points: Array) -> Array:
        densities = family.build(list(points.T[:, :, None])).logpdf(sample.values)
        return np.asarray(densities @ sample.weights)

    return loglik


def distribution(fit: Fit) -> Scaled:
    """Return the distribution of a fit in the unit of the values."""
    return Scaled(FAMILIES[fit.family].build(fit.theta), fit.shift, fit.scale)
