"""What a coordinator and its workers say to each other: which batch to compute, what came of it, and what prevented it.

Everything here is pickled: it travels between processes and machines.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.store import Part, Store
from campaign.worker.moments import Moments
from engine import Run, simulate

Simulate = Callable[..., Run]


class WrongBuild(CampaignError):
    """A worker runs another engine build than the campaign is planned for."""


class Cancelled(CampaignError):
    """The campaign was cancelled before the batch was complete."""

    exit_code = 3


@dataclass(frozen=True)
class CampaignAddress:
    """Where a worker finds a campaign, and what it needs to compute it; less than a kilobyte.

    Attributes
    ----------
    store : str
        URL of the store that holds the plan and takes the rows.
    campaign_id : str
        Id of the campaign.
    engine_build : str
        Build of the engine that the campaign is planned for.
    simulate : callable
        `engine.simulate`, or a function of a module with the same parameters that takes its place.
    """

    store: str
    campaign_id: str
    engine_build: str
    simulate: Simulate = simulate

    @classmethod
    def of(cls, store: Store, plan: Plan, simulate: Simulate = simulate) -> "CampaignAddress":
        """Return the address of a plan in a store; a folder's path becomes absolute, for workers elsewhere."""
        return cls(store.files.root, plan.campaign_id, plan.engine_build, simulate)


@dataclass(frozen=True)
class BatchRequest:
    """A batch to compute.

    Attributes
    ----------
    batch : int
        Batch number.
    attempt : int
        Attempt number, from 1.
    isolated : bool
        Whether its runs are computed in an isolated subprocess, because an earlier attempt killed its worker.
    """

    batch: int
    attempt: int = 1
    isolated: bool = False


@dataclass(frozen=True)
class BatchResult:
    """A batch whose rows are in the store.

    Attributes
    ----------
    part : Part
        The part that was written.
    moments : dict of str to Moments
        Moments of each response over the rows of the batch.
    computed : bool
        Whether the rows were computed now; otherwise the store had them already.
    seconds : float
        How long the batch took [s].
    """

    part: Part
    moments: dict[str, Moments] = field(default_factory=dict)
    computed: bool = True
    seconds: float = 0.0
