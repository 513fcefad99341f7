"""Which response costs the yield of the product: Shapley's attribution of the rejects, and the marginal gain.

The rejects of a set of responses are the samples that break a limit of at least one of them. Shapley's (1953) value
of that game shares each reject equally among the responses that it breaks: a reject that breaks three limits counts a
third for each. It needs neither an enumeration of sets nor random orders, however many responses there are, because
the game is a sum of one game per reject in which those responses are interchangeable and the others contribute
nothing. What Shapley gives to the responses adds up to the reject share.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from reporting.arrays import Array
from reporting.capability.intervals import Interval


@dataclass(frozen=True)
class ResponseLoss:
    """What one response costs of the yield of the product.

    Attributes
    ----------
    response : str
    rejects : int
        Number of samples that break a limit of this response.
    only : int
        Number of those that keep the limits of all other responses: the marginal gain if this one never failed.
    share : float
        Shapley's part of the reject share, as a share of all samples.
    share_interval : (float, float)
        By Fay and Feuer (1997).
    part : float or None
        The same as a part of the rejects; None without a reject.
    yield_without : float
        Yield of the product if this response never failed.
    """

    response: str
    rejects: int
    only: int
    share: float
    share_interval: Interval
    part: float | None
    yield_without: float


def response_losses(failed: dict[str, NDArray[np.bool_]], confidence: float) -> tuple[ResponseLoss, ...]:
    """Return what each response costs of the yield, the most expensive first.

    Parameters
    ----------
    failed : dict of str to array of bool, each of shape (n,)
        Whether each sample breaks a limit of the response; n above 0.
    confidence : float
        Of the two-sided intervals.
    """
    matrix = np.array(list(failed.values()))
    broken = np.count_nonzero(matrix, axis=0)
    rejected, n = int(np.count_nonzero(broken)), broken.size
    losses = []
    for name, column in failed.items():
        weights = 1 / broken[column]
        only = int(np.count_nonzero(broken[column] == 1))
        total = float(np.sum(weights))
        losses.append(
            ResponseLoss(
                response=name,
                rejects=weights.size,
                only=only,
                share=total / n,
                share_interval=weighted_share_interval(weights, n, confidence),
                part=total / rejected if rejected else None,
                yield_without=(n - rejected + only) / n,
            )
        )
    return tuple(sorted(losses, key=lambda loss: -loss.share))


def weighted_share_interval(weights: Array, n: int, confidence: float) -> Interval:
    """Return the two-sided interval of a share in which each counted sample has a weight of at most 1.

    Fay and Feuer (1997, Statistics in Medicine 16, 791-801): gamma limits of a weighted sum of Poisson counts. With
    all weights 1 it is the exact interval of a Poisson count, which contains that of Clopper and Pearson.

    Parameters
    ----------
    weights : array, shape (m,)
        Weight of each counted sample, above 0 and at most 1; may be empty.
    n : int
        Number of samples.
    confidence : float
    """
    total, square = float(np.sum(weights)), float(np.sum(weights**2))
    low_p, high_p = 0.5 - confidence / 2, 0.5 + confidence / 2
    low = square / total * float(gammaincinv(total**2 / square, low_p)) if total > 0 else 0.0
    high = (square + 1) / (total + 1) * float(gammaincinv((total + 1) ** 2 / (square + 1), high_p))
    return low / n, min(high / n, 1.0)
