"""Messages between a coordinator and its workers: requests for batches, results, and errors.

Everything here is pickled, because it is sent between processes and machines.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.row_build import differences
from campaign.store import Part, Store
from campaign.store.files.retry_policy import PATIENT, RetryPolicy
from campaign.worker.moments import Moments
from engine import Run, simulate

Simulate = Callable[..., Run]


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
