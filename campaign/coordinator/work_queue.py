"""What is still to be computed of a campaign, in the order of its samples."""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable

from campaign.plan import Plan
from campaign.worker.batch import Order


class Agenda:
    """Batches to compute, and how far the campaign is complete from its beginning on.

    Parameters
    ----------
    plan : Plan
        The campaign.
    there : iterable of int
        Batches that need not be computed.
    end : int
        Samples from this one on are not asked for.
    """

    def __init__(self, plan: Plan, there: Iterable[int], end: int) -> None:
        self._firsts = [first for first, _ in plan.batches]
        self._batches = self.covering(end)
        self._there = set(there)
        self._waiting = deque(Order(b) for b in range(self._batches) if b not in self._there)
        self._complete = 0  # batches from the beginning on, without a gap
        self.limit = self._batches  # no batch from this one on is handed out yet

    def covering(self, samples: int) -> int:
        """Return how many batches from the first on hold the first ``samples`` samples."""
        return bisect_left(self._firsts, samples)

    def next(self) -> Order | None:
        """Return the next batch to compute, if one may be."""
        if not self._waiting or self._waiting[0].batch >= self.limit:
            return None
        return self._waiting.popleft()

    def again(self, order: Order) -> None:
        """Put a batch back, to be the next."""
        self._waiting.appendleft(order)

    def finish(self, batch: int) -> None:
        """Take note that a batch is there."""
        self._there.add(batch)

    def holds(self, samples: int) -> bool:
        """Return whether the first ``samples`` samples are all there."""
        while self._complete in self._there:
            self._complete += 1
        return self._complete >= self.covering(samples)

    def __len__(self) -> int:
        return len(self._waiting)
