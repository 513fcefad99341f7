"""Changed distributions of a campaign, expressed as a ratio of densities at each of its samples."""

from collections.abc import Mapping
from math import isfinite

import numpy as np

from campaign.errors import SpecError
from campaign.inputs.distributions import Distribution
from campaign.inputs.sampling import SAMPLERS, sampler_named
from campaign.inputs.sampling.correlation import matrix
from campaign.reports.samples_worth import samples_worth
from campaign.spec.campaign_file import CampaignSpec
from engine.arrays import Array
from reporting.tolerance.reweighting import Change

_NEAREST = 1e-16  # distance from 0 and 1 of a probability that becomes a normal score


def check_drawn(spec: CampaignSpec) -> None:
    """Raise SpecError if the samples are not drawn from distributions."""
    if not sampler_named(spec.sampler).weighted:
        *names, last = (name for name, sampler in SAMPLERS.items() if sampler.weighted)
        raise SpecError(
            f"sampler {spec.sampler}: its samples do not follow distributions, so they cannot be weighted for others;"
            f" run a campaign with sampler {', '.join(names)} or {last}"
        )


def change_distributions(spec: CampaignSpec, new: Mapping[str, Distribution], columns: Mapping[str, Array]) -> Change:
    """Return the effect of new distributions of some variables on samples (n,); rank correlations stay the same.

    The effect is the logarithm of the ratio of densities at each sample, and the new probability outside the old
    distributions. Raises SpecError if the samples are not drawn from distributions.
    """
    check_drawn(spec)
    n = next(iter(columns.values())).size
    ratio, inside = np.zeros(n), 1.0
    for name, distribution in new.items():
        old = spec.variables[name]
        ratio += distribution.logpdf(columns[name]) - old.logpdf(columns[name])
        inside *= 1.0 - _outside(distribution, *old.support())
    if any(name in pair for name in new for pair in spec.correlations or ()):
        ratio += _copula({**spec.variables, **new}, spec, columns) - _copula(spec.variables, spec, columns)
    worth = samples_worth([(spec.variables[name], distribution) for name, distribution in new.items()])
    return Change(np.where(np.isnan(ratio), -np.inf, ratio), max(1.0 - inside, 0.0), worth=worth)


def _outside(new: Distribution, low: float, high: float) -> float:
    """Return the probability of values below ``low`` or above ``high``."""
    # just below the bound, because a discrete distribution may have a value on it
    below = float(new.cdf(np.array([np.nextafter(low, -np.inf)]))[0]) if isfinite(low) else 0.0
    above = 1.0 - float(new.cdf(np.array([high]))[0]) if isfinite(high) else 0.0
    return min(max(below + above, 0.0), 1.0)


def _copula(variables: Mapping[str, Distribution], spec: CampaignSpec, columns: Mapping[str, Array]) -> Array:
    """Return the logarithm of the density of the Gaussian copula at samples, without its constant."""
    from scipy.special import ndtri

    correlations = spec.correlations or ()
    names = tuple(name for name in variables if any(name in pair for pair in correlations))
    scores = np.array([ndtri(np.clip(variables[n].cdf(columns[n]), _NEAREST, 1 - _NEAREST)) for n in names])
    excess = np.linalg.inv(matrix(names, correlations)) - np.eye(len(names))
    return np.asarray(-0.5 * np.einsum("in,ij,jn->n", scores, excess, scores), dtype=np.float64)
