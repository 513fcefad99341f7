"""Yield loss of the product by response: Shapley's attribution of the rejects, and the marginal gain.

The rejects of a set of responses are the samples that break a limit of at least one of them. Shapley's (1953) value
of that game shares each reject equally among the responses whose limits it breaks: a reject that breaks the limits of
three responses counts a third for each. Neither sets nor random orders must be enumerated, however many responses there
are, because the game is a sum of one game per reject, in which those responses are interchangeable and the others
contribute nothing. The Shapley values of the responses add up to the reject share.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from reporting.capability.intervals import Interval, share_interval
from reporting.capability.shares import weighted_share_interval


@dataclass(frozen=True)
class ResponseLoss:
    """Yield loss that one response causes."""

    response: str
    rejects: int  # samples that break a limit of this response
    only: int  # those of them that keep all other limits: the marginal gain if this response never failed
    share: float  # Shapley value: part of the reject share, as a share of all samples
    share_interval: Interval  # by Fay and Feuer (1997)
    part: float | None  # Shapley value as a share of the rejects; None without a reject
    yield_without: float  # of the product if this response never failed
    yield_without_interval: Interval  # by Clopper and Pearson


def response_losses(
    failed: dict[str, NDArray[np.bool_]],
    confidence: float,
    effects: Mapping[str, float] = MappingProxyType({}),
    effect: float = 1.0,
) -> tuple[ResponseLoss, ...]:
    """Return the yield loss of each response, the largest first.

    `failed` marks the samples that break a limit of the response, shape (n,) with n above 0. Design effects (samples
    per independent sample): `effects` of the rejects of each response, 1 if not named; `effect` of those of the
    product.
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
                share_interval=weighted_share_interval(weights, n, confidence, effects.get(name, 1.0)),
                part=total / rejected if rejected else None,
                yield_without=(n - rejected + only) / n,
                yield_without_interval=share_interval((n - rejected + only) / effect, n / effect, confidence),
            )
        )
    return tuple(sorted(losses, key=lambda loss: -loss.share))
