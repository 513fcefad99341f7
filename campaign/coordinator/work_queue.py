"""The batches of a campaign still to be computed, in the order of their samples."""

from bisect import bisect_left
from collections import deque
from collections.abc import Mapping, Sequence, Set

from campaign.plan import Plan
from campaign.store import Part
from campaign.worker.messages import BatchRequest


class WorkQueue:
    """Batches to compute, and up to which sample the campaign is complete.

    Batches beyond the first ``end`` samples are left out; ``unrepeated`` are those with a missing repeat. `parts` has
    the parts of completed batches by number; only batches below `limit` are handed out.
    """

    def __init__(self, plan: Plan, parts: Mapping[int, Part], end: int, unrepeated: Set[int] = frozenset()) -> None:
        self._first_samples = [first for first, _ in plan.batches]
        self.parts = dict(parts)
        self._complete_prefix = 0  # number of completed batches from the first on without a gap
        self.limit = self.batches_for(end)
        self._waiting = deque(
            BatchRequest(batch, has_rows=batch in self.parts)
            for batch in range(self.limit)
            if batch not in self.parts or batch in unrepeated
        )

    def batches_for(self, samples: int) -> int:
        """Return the number of batches, from the first on, that hold the first ``samples`` samples."""
        return bisect_left(self._first_samples, samples)

    def next(self) -> BatchRequest | None:
        """Remove and return the next batch to compute; None if there is none below the limit."""
        if not self._waiting or self._waiting[0].batch >= self.limit:
            return None
        return self._waiting.popleft()

    def requeue(self, requests: Sequence[BatchRequest]) -> None:
        """Put batches back at the front of the queue."""
        # in front: behind a batch above the limit they would wait for a checkpoint that waits for them
        self._waiting.extendleft(reversed(requests))

    def complete(self, part: Part) -> None:
        """Record the part of a completed batch."""
        self.parts[part.batch] = part

    def completed(self, samples: int) -> bool:
        """Return whether the rows of all the first ``samples`` samples are in the store."""
        while self._complete_prefix in self.parts:
            self._complete_prefix += 1
        return self._complete_prefix >= self.batches_for(samples)

    def __len__(self) -> int:
        return len(self._waiting)
