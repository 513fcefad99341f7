"""Distributions fitted to a response by maximum likelihood, ranked by AIC, with their distance from the data.

The search uses the sample condensed to 600 values, the figures of merit 20,000 (`reporting.shape.condensed`): a million
values cost as much as a few thousand. Normal and lognormal distributions use the moments of all values; sigma has the
divisor n - 1 as everywhere in the report.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from reporting.arrays import Array
from reporting.capability.moments import ROUNDING, series
from reporting.shape.condensed import Condensed, anderson_darling, condense, distance
from reporting.shape.families import FAMILIES, Family, Scaled, Theta
from reporting.shape.maximum_likelihood import covariance, maximise

SEARCHED, JUDGED = 600, 20_000
# Values needed for each parameter.
VALUES_PER_PARAMETER = 8
# A smaller difference of AIC is not evidence (Burnham, Anderson 2002): the simpler family is chosen.
AIC_MARGIN = 10.0
# Below this ratio of sigma and value a family that starts at zero is indistinguishable from a normal one.
LEAST_VARIATION = 0.01


@dataclass(frozen=True)
class Fit:
    """A family fitted to the values.

    Attributes
    ----------
    family, title : str
        Key in `reporting.shape.families.FAMILIES`, and the name in words.
    parameters : dict of str to float
        Of the distribution of ``z = (x - shift) / scale``; positive parameters themselves, not their logarithms.
    theta : tuple of float
        Unconstrained parameters, which with shift and scale determine the distribution (see `distribution`).
    covariance : tuple of tuples of float, or None
        Of theta, from the curvature of the likelihood; None where it is flat.
    shift, scale : float
        In the unit of the values.
    n : int
        Number of values.
    loglik, aic, bic : float
        Log-likelihood (density in 1/unit), and the information criteria of Akaike and Schwarz.
    ad : float or None
        Anderson-Darling statistic. It grows with n: it ranks families but does not measure a misfit.
    distance : float
        Kolmogorov's distance between sample and distribution: the size of the misfit.
    """

    family: str
    title: str
    parameters: dict[str, float]
    theta: Theta
    covariance: tuple[tuple[float, ...], ...] | None
    shift: float
    scale: float
    n: int
    loglik: float
    aic: float
    bic: float
    ad: float | None
    distance: float


@dataclass(frozen=True)
class Fits:
    """All families fitted to a response.

    Attributes
    ----------
    fits : tuple of Fit
        By AIC, smallest first.
    best : str or None
        Family chosen: among those within `AIC_MARGIN` of the smallest AIC the one with the fewest parameters; of
        several, the normal one.
    refused : dict of str to str
        Families that were not fitted, and why.
    notes : tuple of str
        How the families were fitted, or why none was.
    """

    fits: tuple[Fit, ...]
    best: str | None
    refused: dict[str, str]
    notes: tuple[str, ...]

    def of(self, family: str | None) -> Fit | None:
        """Return the fit of a family; None if there is none."""
        return next((fit for fit in self.fits if fit.family == family), None)


def fit_families(x: ArrayLike, bounds: tuple[float, float] | None = None, names: Iterable[str] | None = None) -> Fits:
    """Fit every family that the values allow.

    Parameters
    ----------
    x : array_like, shape (n,)
        Values of one response; those that are not finite are left out.
    bounds : (float, float), optional
        Physical bounds of the response, for the beta distribution.
    names : iterable of str, optional
        Families to fit; all of them if not given.

    Raises
    ------
    ReportError
        `x` is not a series of numbers.
    """
    values = series(x)
    values = np.sort(values[np.isfinite(values)])
    n = int(values.size)
    if n < 2 or values[-1] - values[0] <= ROUNDING * float(np.max(np.abs(values))):
        return Fits((), None, {}, ("Fewer than two different values, so no distribution is fitted.",))
    if not float(np.max(np.abs(values))) < 1e150:
        return Fits((), None, {}, ("The values are too large to be squared, so no distribution is fitted.",))
    few, many = condense(values, SEARCHED), condense(values, JUDGED)
    families = FAMILIES.values() if names is None else [FAMILIES[name] for name in FAMILIES if name in set(names)]
    fits, refused = [], {}
    for family in families:
        fit = _fit(family, values, few, many, bounds)
        if isinstance(fit, Fit):
            fits.append(fit)
        else:
            refused[family.name] = fit
    fits.sort(key=lambda fit: fit.aic)
    notes: tuple[str, ...] = ()
    if n > SEARCHED:
        notes = (f"Fitted to {SEARCHED} weighted values that represent {n}; both tails are complete.",)
    return Fits(tuple(fits), _choose(fits), refused, notes)


def distribution(fit: Fit, theta: Theta | None = None) -> Scaled:
    """Return the distribution of a fit in the unit of the values; with the parameters `theta`, if given."""
    return Scaled(FAMILIES[fit.family].build(fit.theta if theta is None else theta), fit.shift, fit.scale)


def _choose(fits: list[Fit]) -> str | None:
    """Return the simplest family that is as good as the best."""
    if not fits:
        return None
    close = [fit for fit in fits if fit.aic <= fits[0].aic + AIC_MARGIN]
    return min(close, key=lambda fit: (len(fit.theta), fit.family != "normal", fit.aic)).family


def _fit(
    family: Family, values: Array, few: Condensed, many: Condensed, bounds: tuple[float, float] | None
) -> Fit | str:
    """Return the fit of a family, or why there is none."""
    n, k = int(values.size), len(family.parameters)
    if n < VALUES_PER_PARAMETER * k:
        return f"{n} values are too few for {k} parameters; {VALUES_PER_PARAMETER * k} are needed"
    frame = _frame(family, values, bounds)
    if isinstance(frame, str):
        return frame
    shift, scale = frame
    sample = few.scaled(shift, scale)

    def loglik(theta: Theta) -> float:
        return float(sample.weights @ family.build(theta).logpdf(sample.values))

    with np.errstate(all="ignore"):  # a search may pass through parameters whose likelihood overflows
        theta: Theta | None = _moments_of_all(family, values, shift, scale)
        if theta is None:
            theta = maximise(loglik, family.start(sample))
        if theta is None:
            return "no maximum of the likelihood was found"
        fitted = Scaled(family.build(theta), shift, scale)
        total = float(many.weights @ fitted.logpdf(many.values))
        cdf, sf = fitted.cdf(many.values), fitted.sf(many.values)
        if not math.isfinite(total) or not np.all(np.isfinite(cdf)):
            return "some values are impossible under the distribution that fits the others"
        theta_covariance = covariance(loglik, theta)
    return Fit(
        family=family.name,
        title=family.title,
        parameters=_named(family, theta),
        theta=theta,
        covariance=theta_covariance,
        shift=shift,
        scale=scale,
        n=n,
        loglik=total,
        aic=2 * k - 2 * total,
        bic=k * math.log(n) - 2 * total,
        ad=anderson_darling(many, cdf, sf),
        distance=distance(many, cdf),
    )


def _named(family: Family, theta: Theta) -> dict[str, float]:
    """Return the parameters by name, positive ones without the logarithm."""
    pairs = zip(family.parameters, theta, strict=True)
    return {name.removeprefix("log "): math.exp(t) if name.startswith("log ") else t for name, t in pairs}


def _frame(family: Family, values: Array, bounds: tuple[float, float] | None) -> tuple[float, float] | str:
    """Return shift and scale of a family, or why it cannot describe the values."""
    low, high = float(values[0]), float(values[-1])
    std = float(np.std(values))
    if family.frame == "positive":
        if low <= 0:
            return f"values at or below 0 (smallest {low:.6g}); the family has only positive ones"
        if std < LEAST_VARIATION * high:
            return f"zero is more than {1 / LEAST_VARIATION:.0f} sigma away: too far for a positive family"
        return 0.0, float(np.median(values))
    if family.frame == "bounds":
        if bounds is None:
            return "no bounds are known"
        if not bounds[0] < low <= high < bounds[1]:
            return f"values from {low:.6g} to {high:.6g} reach the bounds {bounds[0]:.6g} and {bounds[1]:.6g}"
        return bounds[0], bounds[1] - bounds[0]
    sign = -1.0 if family.frame.endswith("mirrored") else 1.0
    if family.frame.startswith("free"):
        return float(np.median(values)), sign * std
    half = (high - low) / 2
    return low + half, sign * half


def _moments_of_all(family: Family, values: Array, shift: float, scale: float) -> Theta | None:
    """Return theta of the families that moments determine, from all values; None for other families."""
    if family.name not in ("normal", "lognormal"):
        return None
    z = (values - shift) / scale
    if family.name == "lognormal":
        z = np.log(z)
    return float(np.mean(z)), math.log(float(np.std(z, ddof=1)))
