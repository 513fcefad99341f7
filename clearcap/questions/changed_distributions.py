"""Changed distributions as a ratio of densities at each sample, and how many new runs a sample is worth."""

from collections.abc import Mapping, Sequence
from math import isfinite, prod

import numpy as np

from campaign.errors import SpecError
from campaign.inputs.distributions import Distribution
from campaign.inputs.sampling import SAMPLERS, sampler_named
from campaign.inputs.sampling.correlation import matrix
from campaign.spec.campaign_file import CampaignSpec
from engine.arrays import Array
from reporting.tolerance.reweighting import Change

_LOGITS = np.linspace(-30.0, 30.0, 4001)  # probabilities from 1e-13 to 1 - 1e-13
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


def samples_worth(changes: Sequence[tuple[Distribution, Distribution]]) -> float:
    """Return how many new runs (at most 1) a sample is worth for estimating sigma, for the variable where it is least.

    The variance of a sample's contribution to the weighted estimate of a variance is ``E_old[w^2 (z^2 - 1)^2]``, with
    the weight ``w`` and the value ``z`` in sigmas of the new distribution; that of a new run is ``E_new[(z^2 - 1)^2]``.
    Their ratio is infinite if a normal distribution gets sqrt(2) times its sigma or more.
    """
    # a grid even in the logit is fine in both tails, where the weights may be large; u (1 - u) are its widths
    u = 1.0 / (1.0 + np.exp(-_LOGITS))
    share = u * (1.0 - u)
    share /= share.sum()
    squares, costs = [], []
    for old, new in changes:
        x = new.ppf(u)
        mean, std = new.moments()
        with np.errstate(over="ignore", invalid="ignore"):
            known = np.isfinite(old.logpdf(x))  # the probability outside is judged separately
            weight = np.where(known, np.exp(np.minimum(new.logpdf(x) - old.logpdf(x), 300.0)), 0.0)
            part = ((x - mean) / std) ** 2 - 1.0 if std > 0 else np.zeros_like(x)
            of_new = float(np.sum(share * part**2))
            squares.append(max(float(np.nansum(share * weight)), 1.0))
            costs.append(float(np.nansum(share * weight * part**2)) / of_new if of_new > 0 else 1.0)
    shares = [cost * prod(squares) / square for cost, square in zip(costs, squares, strict=True)]
    return min(1.0, 1.0 / max([1.0, *shares]))
