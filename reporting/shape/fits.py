"""Distributions fitted to a response: all families, those that may be used, and the chosen one.

A family may be used if it passes a test of its fit (`reporting.shape.goodness`). Among these, the family with the
smallest AIC is considered no better than a simpler one within `AIC_MARGIN`. The data do not rule out the families
within `AIC_SUPPORT`, so statements on the tails must be valid for all of them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from reporting.capability.moments import ROUNDING, series
from reporting.shape import atoms
from reporting.shape.atoms import Atom
from reporting.shape.family.families import FAMILIES
from reporting.shape.fitting import SEARCHED, Fit, Fitting
from reporting.shape.goodness import PRACTICAL

# Burnham, Anderson (2002): a family within 2 of the smallest AIC has substantial support.
AIC_MARGIN = 2.0
# Up to this difference the values do not rule out a family: the 95 % point of chi-square plus the margin.
AIC_SUPPORT = 3.84 + AIC_MARGIN


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
    x: ArrayLike,
    bounds: tuple[float, float] | None = None,
    names: Iterable[str] | None = None,
    limits: Sequence[float | None] = (None, None),
) -> Fits:
    """Fit every family that is possible for the values `x`, or those named; values that are not finite are left out.

    `bounds` are the physical bounds of the response, for the beta distribution. A family that contradicts the count of
    values beyond the lower or the upper of the `limits` does not pass. ReportError: `x` is not a series of numbers.
    """
    values = series(x)
    values = np.sort(values[np.isfinite(values)])
    n = int(values.size)
    if n < 2 or values[-1] - values[0] <= ROUNDING * float(np.max(np.abs(values))):
        return unfitted("Fewer than two different values, so no distribution is fitted.")
    # The square of a double above 1e154 overflows, a sum of squares earlier.
    if not float(np.max(np.abs(values))) < 1e150 or not float(np.std(values)) > 0:
        return unfitted("The values are too large or too small to be squared, so no distribution is fitted.")
    ties = atoms.ties(values)
    found = ties.atoms()
    if found:
        said = (*(atoms.in_words(atom) for atom in found), "No smooth distribution describes that, so none is fitted.")
        return unfitted(" ".join(said), found)
    if ties.discrete:
        return unfitted(f"Only {ties.values.size} different values, so no smooth distribution is fitted.")
    fitting = Fitting(values, ties, bounds, limits)
    families = FAMILIES.values() if names is None else [FAMILIES[name] for name in FAMILIES if name in set(names)]
    outcomes = {family.name: fitting.fit(family) for family in families}
    fits = sorted((fit for fit in outcomes.values() if isinstance(fit, Fit)), key=lambda fit: fit.aic)
    refused = {name: reason for name, reason in outcomes.items() if isinstance(reason, str)}
    passing = [fit for fit in fits if fit.passes]
    notes: tuple[str, ...] = ()
    if n > SEARCHED:
        notes = (f"Fitted to {SEARCHED} weighted values that represent {n}; both tails are complete.",)
    if fits and not passing:
        notes += (f"No family is used: of {len(fits)} fitted, none agrees with the values.",)
    return Fits(tuple(fits), _choose(passing), _candidates(passing), (), refused, notes)


def unfitted(reason: str, found: tuple[Atom, ...] = ()) -> Fits:
    """Return a result without fits, with the reason."""
    return Fits((), None, (), found, {}, (reason,))


def _choose(passing: list[Fit]) -> str | None:
    """Return the simplest family that is as good as the best."""
    if not passing:
        return None
    close = [fit for fit in passing if fit.aic <= passing[0].aic + AIC_MARGIN]
    return min(close, key=lambda fit: (len(fit.theta), fit.family != "normal", fit.aic)).family


def handicap(fit: Fit, fits: Fits) -> float:
    """Return the excess of AIC over the smallest one of a family that passes, scaled to `PRACTICAL` values."""
    return _handicap(fit, [each for each in fits.fits if each.passes])


def _handicap(fit: Fit, passing: list[Fit]) -> float:
    return (fit.aic - passing[0].aic) * min(1.0, PRACTICAL / fit.n)


def _candidates(passing: list[Fit]) -> tuple[str, ...]:
    """Return the families that the values do not rule out."""
    return tuple(fit.family for fit in passing if _handicap(fit, passing) <= AIC_SUPPORT)
