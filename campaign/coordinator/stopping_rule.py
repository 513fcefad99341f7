"""Stop a campaign when a number is known narrowly enough.

The rule sees nothing but the rows of the first samples, so it decides alike for any number of workers. Its intervals
are those of a fixed number of samples; a rule on their width that is asked a few dozen times nearly keeps their
coverage (Chow and Robbins 1965: exactly, as the width goes to zero).
"""

import logging
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from campaign.coordinator.work_queue import WorkQueue
from campaign.plan import Plan
from campaign.spec.campaign_file import Response
from campaign.store import Store
from campaign.store.layout import STOPPED

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Verdict:
    """What a stopping rule says of the first samples.

    Attributes
    ----------
    samples : int
        Number of samples that were judged.
    statistic : str
        The statistic and its response, such as ``mean of FC-1``.
    value : float or None
        Value of the statistic; None if the rows do not define it.
    low, high : float or None
        Its confidence interval.
    sure : bool
        Whether half the interval is as narrow as the rule asks.
    """

    samples: int
    statistic: str
    value: float | None
    low: float | None
    high: float | None
    sure: bool

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)

    def text(self) -> str:
        """Return the verdict in words."""
        if self.low is None or self.high is None:
            return f"{self.statistic} is not defined by the first {self.samples} samples"
        return f"{self.statistic} = {self.value:.5g}, {self.low:.5g} to {self.high:.5g}, after {self.samples} samples"


class Checkpoints:
    """The numbers of samples at which a campaign's stopping rule is asked, and its last verdict.

    Parameters
    ----------
    store : Store
        Where the rows are.
    plan : Plan
        The campaign; without a stopping rule, or when it has stopped already, there is no checkpoint.

    Attributes
    ----------
    verdict : Verdict or None
        Of the last checkpoint; None before the first.
    """

    def __init__(self, store: Store, plan: Plan) -> None:
        self.verdict: Verdict | None = None
        self._store, self._plan = store, plan
        rule = plan.spec.stop
        is_open = rule is not None and not store.read_json(plan.campaign_id, STOPPED)
        self._remaining = list(rule.checkpoints(plan.spec.samples)) if rule is not None and is_open else []

    @property
    def next(self) -> int | None:
        """Number of samples of the next checkpoint; None if there is none."""
        return self._remaining[0] if self._remaining else None

    def limit(self, queue: WorkQueue, ahead: int) -> None:
        """Let a queue hand out no more than ``ahead`` batches beyond the next checkpoint."""
        if self.next is not None:
            queue.limit = queue.batches_for(self.next) + ahead

    def reached_end(self, queue: WorkQueue) -> bool:
        """Judge each checkpoint whose samples are completed; return whether the campaign ends at one of them."""
        while self.next is not None and queue.completed(self.next):
            self.verdict = judge(self._store, self._plan, self._remaining.pop(0))
            logger.info("%s", self.verdict.text())
            if self.verdict.sure:
                self._store.write_json(self._plan.campaign_id, STOPPED, self.verdict.to_json())
                self._remaining.clear()
                return True
        return False


def judge(store: Store, plan: Plan, samples: int) -> Verdict:
    """Ask a campaign's stopping rule about its first ``samples`` samples, whose rows must be in the store."""
    rule = plan.spec.stop
    assert rule is not None
    name = f"{rule.statistic} of {rule.response}"
    limits = plan.spec.responses.get(rule.response, Response())
    estimate = _interval(rule.statistic, values(store, plan, rule.response, samples), limits, rule.confidence)
    if estimate is None:
        return Verdict(samples, name, None, None, None, sure=False)
    value, (low, high) = estimate
    return Verdict(samples, name, value, low, high, sure=high - low <= 2.0 * rule.half_width)


def values(store: Store, plan: Plan, response: str, samples: int) -> np.ndarray:
    """Return the values of a response over the first ``samples`` samples, in their order; failed runs are left out."""
    pieces, count = [], 0
    for table in store.stream(plan, ["sample", response]):
        first: pa.Table = table.slice(0, samples - count)
        pieces.append(first[response].drop_null().to_numpy())
        count += first.num_rows
        if count >= samples:
            break
    return np.concatenate(pieces)


def _interval(
    statistic: str, x: np.ndarray, limits: Response, confidence: float
) -> tuple[float, tuple[float, float]] | None:
    """Return a statistic of values and its interval; None where the values do not define it."""
    from reporting import capability  # takes half a second, and few campaigns have a stopping rule
    from reporting.capability.intervals import mean_interval, share_interval, std_interval

    lsl, usl, target = limits.limits()
    c = capability(x, lsl=lsl, usl=usl, target=target, confidence=confidence)
    if statistic == "ppm":
        if c.ppm_observed is None:
            return None
        low, high = share_interval(round(c.ppm_observed * c.n / 1e6), c.n, confidence)
        return c.ppm_observed, (1e6 * low, 1e6 * high)
    if c.mean is None or c.std is None or c.n < 2:
        return None
    if statistic == "mean":
        return c.mean, mean_interval(c.mean, c.std, c.n, confidence)
    if statistic == "std":
        return c.std, std_interval(c.std, c.n, confidence)
    index, interval = (c.cp, c.cp_interval) if statistic == "cp" else (c.cpk, c.cpk_interval)
    return None if index is None or interval is None else (index, interval)
