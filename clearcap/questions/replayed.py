"""Replay a sample of a campaign: compute it again, compare it with its row, and judge differences."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.row_build import differences
from campaign.store import Store
from campaign.worker.row import RepeatedSample, repeated_sample


@dataclass(frozen=True)
class Replay:
    """A replayed sample."""

    campaign: str
    sample: int
    again: RepeatedSample  # both rows, and whether they agree
    differences: str  # of this program from the one that computed the campaign, in words; empty if there are none

    @property
    def is_broken(self) -> bool:
        """Whether the rows differ although the program is the same."""
        return self.again.same is False and not self.differences

    def document(self) -> dict[str, Any]:
        """Return the replay as data, as ``clearcap replay --json`` and the web service write it."""
        replayed = asdict(self.again)
        return {"campaign": self.campaign, "sample": self.sample, **replayed, "differences": self.differences}


def check_sample(plan: Plan, sample: int) -> None:
    """Raise SpecError if the campaign does not have a sample of this number."""
    if not 0 <= sample < plan.spec.samples:
        raise SpecError(f"sample {sample}: campaign {plan.campaign_id} has samples 0 to {plan.spec.samples - 1}")


def replay_sample(store: Store, plan: Plan, sample: int, motion: Path | None = None, *, halved: bool = False) -> Replay:
    """Compute a sample again in this process, and compare it with its stored row, bit for bit.

    `motion` names an HDF5 file to write its motion to; `halved` computes its repeat with half the step instead. Raises
    SpecError if the campaign has no such sample, and the errors of `engine.simulate`.
    """
    check_sample(plan, sample)
    again = repeated_sample(store, plan, sample, motion, halved=halved)
    return Replay(plan.campaign_id, sample, again, differences(plan.row_build))
