"""Stop a campaign once a statistic is known precisely enough.

The rule uses only the rows of the first samples, so its decision does not depend on the number of workers. Its
intervals are those for a fixed number of samples; a rule on their width that is evaluated a few dozen times nearly
keeps their coverage (Chow and Robbins 1965: exactly, as the width goes to zero). With production lots the intervals
are those of lots, and the rule waits for enough lots, however narrow the interval of a single lot's samples is.
"""

import logging
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from campaign.coordinator.dispatch import WorkQueue
from campaign.plan import Plan, resolution
from campaign.spec.campaign_file import Response, Stop
from campaign.store import Store
from campaign.store.layout import STOPPED

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Verdict:
    """The verdict of a stopping rule on the first samples."""

    samples: int  # number of judged samples
    statistic: str  # with its response, such as ``mean of FC-1``
    value: float | None  # None if the rows do not define it
    low: float | None  # end of its confidence interval; None if there is none
    high: float | None
    sure: bool  # whether the campaign may stop: a narrow enough interval, and enough whole lots
    lots: int | None = None  # whole production lots among the samples; None without lots
    reason: str = ""  # why there is no interval; may be empty

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)

    def text(self) -> str:
        """Return the verdict in words."""
        lots = "" if self.lots is None else f", {self.lots} whole production lots"
        if self.low is None or self.high is None:
            why = f": {self.reason}" if self.reason else ""
            return f"no verdict on {self.statistic} after the first {self.samples} samples{lots}{why}"
        interval = f"{self.statistic} = {self.value:.5g}, {self.low:.5g} to {self.high:.5g}"
        return f"{interval}, after {self.samples} samples{lots}"


class Checkpoints:
    """The numbers of samples at which a campaign's stopping rule, if any, is evaluated, and its last `verdict`."""

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
        """Limit a queue to ``ahead`` batches beyond the next checkpoint."""
        if self.next is not None:
            queue.limit = self._plan.batches_before(self.next) + ahead

    def reached_end(self, queue: WorkQueue) -> bool:
        """Evaluate each checkpoint whose samples are complete; return whether the campaign ends at one of them."""
        while self.next is not None and queue.completed(self.next):
            self.verdict = judge(self._store, self._plan, self._remaining.pop(0))
            logger.info("%s", self.verdict.text())
            if self.verdict.sure:
                self._store.write_json(self._plan.campaign_id, STOPPED, self.verdict.to_json())
                self._remaining.clear()
                return True
        return False


def judge(store: Store, plan: Plan, samples: int) -> Verdict:
    """Evaluate a campaign's stopping rule on its first ``samples`` samples, whose rows must be in the store."""
    rule = plan.spec.stop
    assert rule is not None
    from campaign.samples import lots_of  # see `_interval`
    from reporting.capability.lots import LEAST_LOTS
    from reporting.samples import leveled, too_few_ok

    name = f"{rule.statistic} of {rule.response}"
    x, sample = values(store, plan, rule.response, samples)
    policy = plan.spec.failures
    fit = samples if policy.max_not_assemblable is None else samples - unfit(store, plan, samples)
    if too_few_ok(x.size, fit, least := policy.min_ok):
        reason = f"{fit - x.size} of them failed, and failures.min_ok requires {100 * least:g} % ok runs"
        return Verdict(samples, name, None, None, None, sure=False, reason=reason)
    x = leveled(x, *resolution(plan.mechanism, rule.response))
    lots = lots_of(plan, sample)
    # with one more sample: it tells whether the last judged one ends its lot
    further = lots_of(plan, np.arange(samples + 1))
    whole = None if further is None else int(further[-1])
    estimate, reason = _interval(rule, x, plan.spec.responses.get(rule.response, Response()), lots)
    if estimate is None:
        return Verdict(samples, name, None, None, None, sure=False, lots=whole, reason=reason)
    value, (low, high) = estimate
    sure = high - low <= 2.0 * rule.half_width and (whole is None or whole >= LEAST_LOTS)
    return Verdict(samples, name, value, low, high, sure=sure, lots=whole)


def values(store: Store, plan: Plan, response: str, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of a response among the first ``samples`` samples, and their numbers; without failed runs."""
    pieces, numbers, count = [np.zeros(0)], [np.zeros(0, np.int64)], 0
    for table in store.stream(plan, ["sample", response]):
        first: pa.Table = table.slice(0, samples - count)
        with_value = first.filter(first[response].is_valid())
        pieces.append(with_value[response].to_numpy())
        numbers.append(with_value["sample"].to_numpy())
        count += first.num_rows
        if count >= samples:
            break
    return np.concatenate(pieces), np.concatenate(numbers)


def unfit(store: Store, plan: Plan, samples: int) -> int:
    """Return how many of the first ``samples`` samples cannot be assembled."""
    from reporting.samples import NOT_ASSEMBLABLE

    found = 0
    for table in store.stream(plan, ["sample", "status"]):
        first = table.filter((pc.field("sample") < samples) & (pc.field("status") == NOT_ASSEMBLABLE))
        found += first.num_rows
    return found


def _interval(
    rule: Stop, x: np.ndarray, limits: Response, lots: np.ndarray | None
) -> tuple[tuple[float, tuple[float, float]] | None, str]:
    """Return a statistic of values with its interval, or None and the reason."""
    from reporting import capability  # takes half a second, and few campaigns have a stopping rule
    from reporting.capability.shares import nonconforming

    lsl, usl, target = limits.limits()
    c = capability(x, lsl=lsl, usl=usl, target=target, confidence=rule.confidence, batches=lots, ordered=False)
    if rule.statistic == "ppm":
        counted = nonconforming(x, lsl, usl, rule.confidence, lots=lots)
        return (None, "there is no value") if counted is None else ((counted.total.ppm, counted.total.interval), "")
    value, interval = getattr(c, rule.statistic), getattr(c, f"{rule.statistic}_interval")
    if c.std == 0 and rule.statistic in ("mean", "std"):  # a constant
        return (value, (value, value)), ""
    if value is None or interval is None:
        return None, c.interval_reason or " ".join(c.notes)
    return (value, interval), ""
