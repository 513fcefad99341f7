"""How many new runs a sample of one distribution is worth for another, from the distributions alone."""

from collections.abc import Sequence
from math import prod

import numpy as np

from campaign.inputs.distributions import Distribution

_LOGITS = np.linspace(-30.0, 30.0, 4001)  # probabilities from 1e-13 to 1 - 1e-13


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
