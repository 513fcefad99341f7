"""Correlations of the responses with each other: which functional conditions fail together, and which compete.

Pearson's r, with the interval of Fisher's z transformation, which assumes two normal responses; and Spearman's rank
correlation, which assumes nothing and finds any monotone relation.
"""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import ndtri

from reporting.arrays import centred_ranks
from reporting.capability.intervals import Interval
from reporting.capability.lots import describe_lots, independent
from reporting.samples import Samples
from reporting.spec import ReportSpec

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
    n: int  # samples


def response_correlations(samples: Samples, spec: ReportSpec, confidence: float) -> tuple[ResponseCorrelation, ...]:
    """Return the correlations of all pairs of responses that vary, the strongest first; empty for few samples.

    Empty too if the samples are not production: the correlations of corners say nothing about parts.
    """
    names, found = [r.name for r in spec.responses][:MOST], list[ResponseCorrelation]()
    if not spec.design.production:
        return ()
    has = {name: samples.ok & np.isfinite(samples.values[name]) for name in names}
    whole = {name: centred_ranks(samples.values[name][has[name]]) for name in names}
    for both in combinations(names, 2):
        first, second = both
        rows = np.flatnonzero(has[first] & has[second])
        if rows.size < FEWEST:
            continue
        columns = [samples.values[name][rows] for name in both]
        pair = [column - column.mean() for column in columns]
        ranks = [
            whole[name] if whole[name].size == rows.size else centred_ranks(column)
            for name, column in zip(both, columns, strict=True)
        ]
        size = math.prod(float(np.linalg.norm(column)) for column in pair)
        if not size > 0.0:
            continue
        r = min(max(float(pair[0] @ pair[1]) / size, -1.0), 1.0)
        rank = float(ranks[0] @ ranks[1]) / math.prod(float(np.linalg.norm(column)) for column in ranks)
        worth = float(rows.size)
        if samples.lots is not None and not independent(samples.lots):
            worth = min(describe_lots(column, samples.lots[rows]).effective for column in pair)
        found.append(ResponseCorrelation(first, second, r, fisher_interval(r, worth, confidence), rank, rows.size))
    return tuple(sorted(found, key=lambda each: -abs(each.pearson)))


def fisher_interval(r: float, n: float, confidence: float) -> Interval:
    """Return the two-sided interval of Pearson's r of n pairs, by Fisher's z; [-1, 1] up to three pairs."""
    if n <= 3.0:
        return -1.0, 1.0
    if abs(r) >= 1.0:
        return r, r
    half = float(ndtri(0.5 + confidence / 2)) / math.sqrt(n - 3.0)
    return math.tanh(math.atanh(r) - half), math.tanh(math.atanh(r) + half)
