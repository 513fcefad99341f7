"""Stop when sure: whether the first so many samples say a number narrowly enough.

The rule sees nothing but rows of the first samples, so it decides alike wherever it is asked. Intervals are those of
a fixed number of samples; a rule on their width, asked a few dozen times, keeps their coverage nearly (Chow and Robbins
1965: exactly, as the width goes to zero).
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from campaign.plan import Plan
from campaign.spec.campaign_file import Response
from campaign.store import Store


@dataclass(frozen=True)
class Verdict:
    """What a stopping rule says of the first samples.

    Attributes
    ----------
    samples : int
        How many were looked at.
    statistic : str
        What of which response.
    value : float or None
        Its value; None if these rows do not define it.
    low, high : float or None
        Its confidence interval.
    sure : bool
        Whether half the interval is as narrow as asked.
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


def judge(store: Store, plan: Plan, samples: int) -> Verdict:
    """Ask a campaign's stopping rule about its first ``samples`` samples, which must be there."""
    rule = plan.spec.stop
    assert rule is not None
    name = f"{rule.statistic} of {rule.response}"
    asked = plan.spec.responses.get(rule.response, Response())
    found = _interval(rule.statistic, values(store, plan, rule.response, samples), asked, rule.confidence)
    if found is None:
        return Verdict(samples, name, None, None, None, sure=False)
    value, (low, high) = found
    return Verdict(samples, name, value, low, high, sure=high - low <= 2.0 * rule.half_width)


def values(store: Store, plan: Plan, response: str, samples: int) -> np.ndarray:
    """Return a response of the first ``samples`` samples, in their order; failed runs are left out."""
    pieces, count = [], 0
    for table in store.stream(plan, ["sample", response]):
        first: pa.Table = table.slice(0, samples - count)
        pieces.append(first[response].drop_null().to_numpy())
        count += first.num_rows
        if count >= samples:
            break
    return np.concatenate(pieces)


def _interval(
    statistic: str, x: np.ndarray, asked: Response, confidence: float
) -> tuple[float, tuple[float, float]] | None:
    """Return a statistic of values and its interval; None where they do not define it."""
    from reporting import capability
    from reporting.capability.intervals import mean_interval, share_interval, std_interval

    lsl, usl, target = asked.limits()
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
