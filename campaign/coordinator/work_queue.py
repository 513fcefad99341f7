"""The batches of a campaign that are still to be computed, in the order of their samples."""

from bisect import bisect_left
from collections import deque
from collections.abc import Mapping, Sequence, Set

from campaign.plan import Plan
from campaign.store import Part
from campaign.worker.messages import BatchRequest


class WorkQueue:
    """Batches to compute, and how far the campaign is complete from its first sample on.

    Parameters
    ----------
    plan : Plan
        The campaign.
    parts : mapping of int to Part
        What the store has, by batch number.
    end : int
        Number of samples to compute; batches beyond them are left out.
    unrepeated : set of int
        Batches of whose samples a repeat is missing.

    Attributes
    ----------
    parts : dict of int to Part
        The parts of the completed batches.
    limit : int
        No batch from this number on is handed out yet.
    """

    def __init__(self, plan: Plan, parts: Mapping[int, Part], end: int, unrepeated: Set[int] = frozenset()) -> None:
        self._first_samples = [first for first, _ in plan.batches]
        self.parts = dict(parts)
        self._complete_prefix = 0  # number of batches from the first on that are completed without a gap
        self.limit = self.batches_for(end)
        self._waiting = deque(
            BatchRequest(batch, has_rows=batch in self.parts)
            for batch in range(self.limit)
            if batch not in self.parts or batch in unrepeated
        )

    def batches_for(self, samples: int) -> int:
        """Return how many batches from the first on hold the first ``samples`` samples."""
        return bisect_left(self._first_samples, samples)

    def next(self) -> BatchRequest | None:
        """Take out the next batch to compute; None if there is none below the limit."""
        if not self._waiting or self._waiting[0].batch >= self.limit:
            return None
        return self._waiting.popleft()

    def requeue(self, requests: Sequence[BatchRequest]) -> None:
        """Put batches back as the next ones."""
        self._waiting.extendleft(reversed(requests))

    def complete(self, part: Part) -> None:
        """Take in the part of a batch that is completed."""
        self.parts[part.batch] = part

    def completed(self, samples: int) -> bool:
        """Return whether the rows of all the first ``samples`` samples are in the store."""
        while self._complete_prefix in self.parts:
            self._complete_prefix += 1
        return self._complete_prefix >= self.batches_for(samples)

    def __len__(self) -> int:
        return len(self._waiting)
