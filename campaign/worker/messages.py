"""Messages between a coordinator and its workers: requests for batches, results, and errors.

Everything here is pickled, because it is sent between processes and machines.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.row_build import differences
from campaign.store import Part, Store
from campaign.store.files.retry_policy import PATIENT, RetryPolicy
from engine import Run, simulate

Simulate = Callable[..., Run]


@dataclass(frozen=True)
class Moments:
    """Number, mean and sum of squared deviations of a set of values; a sum of two describes both sets together.

    The formula of Chan, Golub and LeVeque (1983) loses no digits if the mean is large.
    """

    n: int = 0
    mean: float = 0.0  # 0 if there are no values
    squares: float = 0.0  # sum of squared deviations from the mean

    def __add__(self, other: "Moments") -> "Moments":
        n = self.n + other.n
        if not self.n or not other.n:
            return self if self.n else other
        difference = other.mean - self.mean
        mean = self.mean + difference * other.n / n
        return Moments(n, mean, self.squares + other.squares + difference * difference * self.n * other.n / n)

    @property
    def std(self) -> float | None:
        """Standard deviation with divisor n - 1; None for fewer than two values."""
        return math.sqrt(self.squares / (self.n - 1)) if self.n > 1 else None


class WrongBuild(CampaignError):
    """A process runs another build of clearcap than the one the campaign is planned for."""


class ChildFailed(CampaignError):
    """The process that computes runs in isolation failed for reasons of its own; no run is to blame."""


class DoubtfulRun(CampaignError):
    """A run raised an error that the machine may have caused; ``row`` is its row if the run itself did."""

    def __init__(self, row: dict[str, Any]) -> None:
        super().__init__(row)
        self.row = row


class Cancelled(CampaignError):
    """The campaign was cancelled before the batch was complete."""

    exit_code = 3


@dataclass(frozen=True)
class CampaignAddress:
    """Where a worker finds a campaign, and how it computes it; less than a kilobyte."""

    store: str = field(repr=False)  # URL of the store, with its secrets, so it must not be shown
    campaign_id: str
    row_build: str  # that the campaign is planned for; see `campaign.row_build`
    simulate: Simulate = simulate  # `engine.simulate`, or a module-level function with the same parameters
    retry_policy: RetryPolicy = PATIENT  # for failing operations on the store
    repeats: tuple[float, ...] = ()  # shares of the samples that are repeated; see `campaign.plan_header.plan_repeats`
    halved: bool = False  # whether runs have half the step, as repeats do

    @classmethod
    def of(
        cls, store: Store, plan: Plan, simulate: Simulate = simulate, repeats: tuple[float, ...] = ()
    ) -> "CampaignAddress":
        """Return the address of a plan in a store; a folder's path becomes absolute, for workers elsewhere."""
        return cls(store.files.full_url, plan.campaign_id, plan.row_build, simulate, store.files.retry_policy, repeats)


def check_build(campaign_id: str, planned: str) -> None:
    """Raise WrongBuild, which says what differs, unless a campaign is planned for the build of this process."""
    if different := differences(planned):
        raise WrongBuild(
            f"campaign {campaign_id} is planned for another build of clearcap ({different}); its rows must"
            " not mix with rows of this one: install that build here, or plan the campaign again with clearcap run"
        )


@dataclass(frozen=True)
class BatchRequest:
    """A batch to compute."""

    batch: int
    attempt: int = 1  # from 1
    isolated: bool = False  # compute the runs in a subprocess, because an earlier attempt killed its worker
    has_rows: bool = False  # the store has the rows, so that only repeats of the samples are missing


@dataclass(frozen=True)
class BatchResult:
    """A batch whose rows, and the repeats of its samples, are in the store."""

    part: Part | None  # None if the request was for repeats only
    moments: dict[str, Moments] = field(default_factory=dict)  # of each response over the rows of the batch
    computed: bool = True  # whether the rows were computed now; otherwise the store had them already
    seconds: float = 0.0  # that the batch took
    repeats: int = 0  # number of repeats of its samples


# -- moments of responses while a campaign runs ------------------------------------------------------------------------


def moments(table: pa.Table, responses: Iterable[str]) -> dict[str, Moments]:
    """Return the moments of each response over the plain rows of a table; rows without a value do not count."""
    moments_of, table = {}, plain_rows(table)
    for name in responses:
        x = table[name].drop_null().to_numpy()
        mean = float(x.sum()) / x.size if x.size else 0.0
        deviations = x - mean
        moments_of[name] = Moments(x.size, mean, float((deviations * deviations).sum()))
    return moments_of


def plain_rows(table: pa.Table) -> pa.Table:
    """Return the rows drawn from the distributions themselves: all rows, except with importance sampling."""
    return table.filter(pc.field("component") == 0) if "component" in table.column_names else table


def add_moments(total: dict[str, Moments], more: dict[str, Moments]) -> None:
    """Add the moments of further rows to a total, response by response."""
    for name, m in more.items():
        total[name] = total.get(name, Moments()) + m
