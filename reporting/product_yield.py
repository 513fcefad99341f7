"""Yield of the whole product: the share of samples that keep the limits of all responses together, and its losses.

The loss by a response is Shapley's attribution of the rejects. The rejects of a set of responses are the samples that
break a limit of at least one of them. Shapley's (1953) value of that game shares each reject equally among the
responses whose limits it breaks: a reject that breaks the limits of three responses counts a third for each. Neither
sets nor random orders must be enumerated, however many responses there are, because the game is a sum of one game per
reject, in which those responses are interchangeable and the others contribute nothing. The Shapley values of the
responses add up to the reject share.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtr, pdtrc

from reporting.arrays import Array
from reporting.capability.intervals import Interval, share_interval, share_lower_bound
from reporting.capability.lots import describe_lots, design_effect, independent
from reporting.capability.shares import weighted_share_interval
from reporting.samples import Samples
from reporting.sensitivity.reject_attribution import RejectAttribution, reject_attribution
from reporting.spec import ReportSpec, ResponseSpec

# Below this probability independence of the responses does not explain how often several fail together.
_CHANCE = 0.05


@dataclass(frozen=True)
class CountedYield:
    """A counted share of conforming samples."""

    conforming: int  # samples that keep every limit
    n: int  # all samples
    share: float
    interval: Interval  # two-sided
    lower: float  # one-sided lower bound
    worth: float  # effective number of independent samples; n without production lots


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


@dataclass(frozen=True)
class ProductYield:
    """Yield of the whole product, the rolled throughput yield, and the loss by response and variable."""

    responses: tuple[str, ...]  # those with limits; the product conforms if all of them do
    # of the ok samples with a value of each of these responses; None without such a sample
    counted: CountedYield | None
    # Of all finished samples; failed ones, and those that cannot be assembled or have no value, count as rejects
    with_failures: CountedYield
    # Rolled throughput yield: the product of the yields of the responses. It is the yield of the product if they fail
    # independently.
    rolled: float | None
    dependence: str  # what the difference between yield and rolled yield means, in a sentence; empty with one response
    losses: tuple[ResponseLoss, ...]  # of each response, the largest first
    by_variable: RejectAttribution | None  # attribution of the rejects; None without variables or samples


def product_yield(samples: Samples, spec: ReportSpec, confidence: float, unfit: int = 0) -> ProductYield | None:
    """Return the yield of the whole product; None without limits or samples, or if samples are not production.

    ``unfit`` is the number of further samples whose parts cannot be assembled; they count as rejects beside the failed.
    """
    limited = [r for r in spec.responses if r.lsl is not None or r.usl is not None]
    finished = samples.sample.size
    if not limited or finished == 0 or not spec.design.production:
        return None
    lots = None if samples.lots is None or independent(samples.lots) else samples.lots
    complete = samples.ok & np.all([np.isfinite(samples.values[r.name]) for r in limited], axis=0)
    failed = {r.name: _out(r, samples)[complete] for r in limited}
    n = int(np.count_nonzero(complete))
    rejected = np.any(list(failed.values()), axis=0)
    conforming = n - int(np.count_nonzero(rejected))
    inputs = {v.name: samples.values[v.name][complete] for v in spec.variables}
    lots = None if lots is None else lots[complete]
    values = {name: samples.values[name][complete] for name in failed}
    effect, effects = _effects(failed, rejected, lots, values, confidence)
    rolled = math.prod(1 - float(np.mean(out)) for out in failed.values()) if n else None
    return ProductYield(
        responses=tuple(failed),
        counted=count_yield(conforming, n, confidence, effect) if n else None,
        with_failures=count_yield(conforming, finished + unfit, confidence, effect),
        rolled=rolled,
        dependence=dependence(failed, independent_samples=lots is None),
        losses=response_losses(failed, confidence, effects, effect) if n else (),
        by_variable=reject_attribution(inputs, rejected, confidence, lots) if n and inputs else None,
    )


def count_yield(conforming: int, n: int, confidence: float, effect: float = 1.0) -> CountedYield:
    """Return the yield from a count, with the exact interval and bound of Clopper and Pearson (1934); n above 0.

    With production lots, n is replaced by the effective number of independent samples ``n / effect`` (Korn and Graubard
    1998).
    """
    return CountedYield(
        conforming=conforming,
        n=n,
        share=conforming / n,
        interval=share_interval(conforming / effect, n / effect, confidence),
        lower=share_lower_bound(conforming / effect, n / effect, confidence),
        worth=n / effect,
    )


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


def dependence(failed: dict[str, NDArray[np.bool_]], *, independent_samples: bool = True) -> str:
    """Return whether the responses fail together, in words; empty with one response or without samples.

    The function counts failures of responses in samples that another response has already rejected. If the responses
    are independent and rejects are rare, this count is approximately Poisson around its expectation; with many rejects
    it varies less, so the result is conservative. Samples of a production lot fail together even if the responses are
    not related.
    """
    matrix = np.array(list(failed.values()))
    if len(failed) < 2 or matrix.size == 0:
        return ""
    failures, rejected = int(np.count_nonzero(matrix)), int(np.count_nonzero(matrix.any(axis=0)))
    if failures == 0:
        return "No response fails, so both are 100 %."
    if not independent_samples:
        return "Samples of a production lot fail together, so the difference does not show whether responses do."
    rolled = math.prod(1 - matrix.mean(axis=1))
    # Both directions are tested, each with half of the permitted chance.
    repeated, expected = failures - rejected, max(failures - matrix.shape[1] * (1 - rolled), 0.0)
    if repeated > 0 and float(pdtrc(repeated - 1, expected)) < _CHANCE / 2:
        return (
            "Responses fail in the same samples more often than independent ones would, so fewer samples are lost than "
            "the product of the single yields says."
        )
    if float(pdtr(repeated, expected)) < _CHANCE / 2:
        return (
            "Responses fail in the same samples less often than independent ones would, so more samples are lost than "
            "the product of the single yields says."
        )
    return "The difference is no larger than chance makes it if responses fail independently."


def _effects(
    failed: dict[str, NDArray[np.bool_]],
    rejected: NDArray[np.bool_],
    lots: NDArray[np.int64] | None,
    values: Mapping[str, Array],
    confidence: float,
) -> tuple[float, dict[str, float]]:
    """Return the design effects (samples per independent sample) for the yield of the product and of each response.

    The product has no intraclass correlation of its own: the largest one of its responses is used.
    """
    if lots is None or rejected.size == 0:
        return 1.0, {}
    described = {name: describe_lots(values[name], lots) for name in failed}
    most = max(described.values(), key=lambda each: each.intraclass)
    effects = {name: design_effect(out, lots, described[name], confidence) for name, out in failed.items()}
    return design_effect(rejected, lots, most, confidence), effects


def _out(response: ResponseSpec, samples: Samples) -> NDArray[np.bool_]:
    """Return whether each sample breaks a limit of a response; a value on a limit conforms."""
    values = samples.values[response.name]
    low = -math.inf if response.lsl is None else response.lsl
    high = math.inf if response.usl is None else response.usl
    return (values < low) | (values > high)
