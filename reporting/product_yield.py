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
from functools import reduce
from itertools import combinations
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtr, pdtrc

from reporting.arrays import Array, Columns, centred_ranks, some_of
from reporting.capability.intervals import (
    Interval,
    fisher_interval,
    share_interval,
    share_lower_bound,
    share_upper_bound,
)
from reporting.capability.lots import describe_lots, design_effect, independent
from reporting.capability.shares import weighted_share_interval
from reporting.format_numbers import grouped, short_percent
from reporting.samples import NOT_ASSEMBLABLE, Samples
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
    """Return the yield of the whole product, with `unfit` more rejects; None without limits, samples or production."""
    limited = [r for r in spec.responses if r.lsl is not None or r.usl is not None]
    finished = samples.sample.size
    if not limited or finished == 0 or not spec.design.production:
        return None
    complete = reduce(np.logical_and, (np.isfinite(samples.values[r.name]) for r in limited), samples.ok)
    failed = {r.name: _out(r, samples)[complete] for r in limited}
    n = int(np.count_nonzero(complete))
    rejected = reduce(np.logical_or, failed.values())
    conforming = n - int(np.count_nonzero(rejected))
    inputs = Columns({v.name: samples.values[v.name] for v in spec.variables}).where(complete)
    lots = None if independent(samples.lots) or samples.lots is None else samples.lots[complete]
    values = Columns({name: samples.values[name] for name in failed}).where(complete)
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
    """Return the yield from a count, by Clopper and Pearson, of ``n / effect`` independent samples; n above 0."""
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
    """Return the loss of each response from the samples that break its limit, largest first; with design effects."""
    columns = list(failed.values())
    out, n = np.flatnonzero(reduce(np.logical_or, columns)), columns[0].size
    among = {name: column[out] for name, column in failed.items()}
    broken, rejected = np.count_nonzero(list(among.values()), axis=0), out.size
    losses = []
    for name, column in among.items():
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

    Failures in samples that another response has already rejected are counted. If responses are independent and rejects
    rare, this count is about Poisson around its expectation; with many rejects it varies less, so this is conservative.
    """
    columns = list(failed.values())
    if len(columns) < 2 or columns[0].size == 0:
        return ""
    n, counts = columns[0].size, [int(np.count_nonzero(column)) for column in columns]
    failures, rejected = sum(counts), int(np.count_nonzero(reduce(np.logical_or, columns)))
    if failures == 0:
        return "No response fails, so both are 100 %."
    if not independent_samples:
        return "Samples of a production lot fail together, so the difference does not show whether responses do."
    rolled = math.prod(1 - count / n for count in counts)
    # Both directions are tested, each with half of the permitted chance.
    repeated, expected = failures - rejected, max(failures - n * (1 - rolled), 0.0)
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
    """Return the design effects for the product, by the largest intraclass correlation, and for each response."""
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


# Correlations of the responses with each other: which functional conditions fail together, and which compete.
# Pearson's r, with the interval of Fisher's z transformation, which assumes two normal responses; and Spearman's rank
# correlation, which assumes nothing and finds any monotone relation.

FEWEST = 30  # samples with values of all responses
MOST = 50  # responses, in the order of the mechanism


@dataclass(frozen=True)
class ResponseCorrelation:
    """Correlation of two responses over the samples that have values of both."""

    first: str
    second: str
    pearson: float
    interval: Interval  # of Pearson's r, by Fisher's z; with production lots, of as many independent samples
    rank: float  # Spearman's
    n: int  # samples, at most 200,000 random ones of those that have both


def response_correlations(samples: Samples, spec: ReportSpec, confidence: float) -> tuple[ResponseCorrelation, ...]:
    """Return the correlations of all pairs of responses that vary, the strongest first; empty for few samples."""
    names, found = [r.name for r in spec.responses][:MOST], list[ResponseCorrelation]()
    if not spec.design.production:
        return ()
    has = {name: samples.ok & np.isfinite(samples.values[name]) for name in names}
    known = {name: int(np.count_nonzero(mask)) for name, mask in has.items()}
    of_one = {name: _some(mask) for name, mask in has.items()}
    whole = {name: centred_ranks(samples.values[name][of_one[name]]) for name in names}
    for both in combinations(names, 2):
        mask = has[both[0]] & has[both[1]]
        count = int(np.count_nonzero(mask))
        if count < FEWEST:
            continue
        rows = of_one[both[0]] if count == known[both[0]] else _some(mask)
        columns = [samples.values[name][rows] for name in both]
        pair = [column - column.mean() for column in columns]
        ranks = [
            whole[name] if known[name] == count else centred_ranks(column)
            for name, column in zip(both, columns, strict=True)
        ]
        # the mean of equal values may differ from them by rounding; their ranks do not
        size, of_ranks = (math.prod(float(np.linalg.norm(column)) for column in columns) for columns in (pair, ranks))
        if not (size > 0.0 and of_ranks > 0.0):
            continue
        r = min(max(float(pair[0] @ pair[1]) / size, -1.0), 1.0)
        rank = float(ranks[0] @ ranks[1]) / of_ranks
        worth = float(rows.size)
        if samples.lots is not None and not independent(samples.lots):
            worth = min(describe_lots(column, samples.lots[rows]).effective for column in pair)
        found.append(ResponseCorrelation(*both, r, fisher_interval(r, worth, confidence), rank, rows.size))
    return tuple(sorted(found, key=lambda each: -abs(each.pearson)))


def _some(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the rows for which a mask is True, at most 200,000 random ones, in order."""
    return np.sort(some_of(mask))


# The share of samples whose parts cannot be assembled, with its interval, and the limit that it has to keep.
#
# Such a sample is no failed run but a result: its parts do not fit. Where the campaign sets a limit to their share,
# they are judged by it, and everything else is about the samples that can be assembled; without a limit they count
# among the failed samples, as what their responses would be is not known.


@dataclass(frozen=True)
class AssemblyShare:
    """Share of the finished samples whose parts cannot be assembled, and how it compares with its limit."""

    count: int
    n: int  # finished samples
    share: float
    interval: Interval  # two-sided, by Clopper and Pearson; with production lots, of as many independent samples
    limit: float | None  # largest allowed share; None without one
    # "kept" or "exceeded" if the one-sided bound of the share is on that side of the limit, "open" if neither is; empty
    # without a limit
    verdict: str
    words: str  # all this in a sentence


def assembly_share(samples: Samples, spec: ReportSpec, confidence: float) -> AssemblyShare | None:
    """Return the share that cannot be assembled; None without one and without a limit, or if not production."""
    n, rows, limit = samples.sample.size, samples.rows_of(NOT_ASSEMBLABLE), spec.max_not_assemblable
    if not n or not spec.design.production or (limit is None and not rows.size):
        return None
    stuck, effect = np.zeros(n, bool), 1.0
    stuck[rows] = True
    if samples.lots is not None and not independent(samples.lots):
        effect = design_effect(stuck, samples.lots, describe_lots(stuck.astype(float), samples.lots), confidence)
    count, worth = rows.size / effect, n / effect
    low, high = share_interval(count, worth, confidence)
    verdict = ""
    if limit is not None:
        kept = share_upper_bound(count, worth, confidence) <= limit
        verdict = "kept" if kept else "exceeded" if share_lower_bound(count, worth, confidence) > limit else "open"
    words = (
        f"{grouped(rows.size)} of {grouped(n)} samples cannot be assembled ({short_percent(rows.size / n)}, "
        f"{short_percent(low)} to {short_percent(high)})"
    )
    if limit is not None:
        ends = {"kept": "is kept", "exceeded": "is exceeded", "open": "may be exceeded: more samples would tell"}
        words += f"; the limit of {short_percent(limit)} {ends[verdict]}"
    return AssemblyShare(int(rows.size), n, rows.size / n, (low, high), limit, verdict, words)


def assembled(samples: Samples, spec: ReportSpec) -> Samples:
    """Return the samples that the rest of a report is about: without those that are judged by a limit of their own."""
    rows = samples.rows_of(NOT_ASSEMBLABLE)
    if spec.max_not_assemblable is None or not spec.design.production or not rows.size:
        return samples
    fit = np.ones(samples.sample.size, bool)
    fit[rows] = False
    return samples.where(fit)
