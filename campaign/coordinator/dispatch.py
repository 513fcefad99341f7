"""Dispatch batches to workers: which are waiting, how many are in flight, and pauses after failures."""

import logging
import time
from collections import deque
from collections.abc import Mapping, Sequence, Set
from concurrent.futures import Future
from dataclasses import replace

from campaign.cluster.workers import NoWorkerLeft, Workers
from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.store import Part, Store
from campaign.store.manifest import batches_in, segment_of
from campaign.waits import Wait
from campaign.worker.batch import run_batches
from campaign.worker.messages import BatchRequest, BatchResult, CampaignAddress

logger = logging.getLogger(__name__)

CALLS_PER_WORKER = 3  # in flight: one runs, one waits at the worker, one at the scheduler
CALL_SECONDS = 0.5  # s; the most that batches sent in one call may take: dask spends milliseconds on each call
CALLS_PER_SECOND = 100  # of all workers, above which calls may take longer: a scheduler of thousands serves 130 to 400
LARGEST_CALL = 20  # batches
WARN_AFTER = 60.0  # s without a worker
TRIES = 10  # attempts in a row at a batch
PAUSES = (0.5, 15.0)  # s; the first and the longest pause; each is twice as long as the one before


class WorkQueue:
    """Batches to compute in the order of their samples, and ``parts``, those of completed ones, by number.

    Batches beyond the first ``end`` samples are left out; ``unrepeated`` are those with a missing repeat. Only batches
    below `limit` are handed out. `unrecorded` are the segments of the manifest that lack a part, None: perhaps all.
    """

    def __init__(self, plan: Plan, parts: Mapping[int, Part], end: int, unrepeated: Set[int] = frozenset()) -> None:
        self._plan = plan
        self.parts = dict(parts)
        self.unrecorded: set[int] | None = None
        self._complete_prefix = 0  # number of completed batches from the first on without a gap
        self.limit = plan.batches_before(end)
        # numbers only: 200,000 requests take half a second to make
        self._fresh = deque(batch for batch in range(self.limit) if batch not in self.parts or batch in unrepeated)
        self._again = deque[BatchRequest]()

    def next(self) -> BatchRequest | None:
        """Remove and return the next batch to compute; None if there is none below the limit."""
        if self._again:
            return self._again.popleft() if self._again[0].batch < self.limit else None
        if not self._fresh or self._fresh[0] >= self.limit:
            return None
        batch = self._fresh.popleft()
        return BatchRequest(batch, has_rows=batch in self.parts)

    def requeue(self, requests: Sequence[BatchRequest]) -> None:
        """Put batches back at the front of the queue."""
        # in front: behind a batch above the limit they would wait for a checkpoint that waits for them
        self._again.extendleft(reversed(requests))

    def complete(self, part: Part) -> None:
        """Record the part of a completed batch."""
        self.parts[part.batch] = part
        if self.unrecorded is not None:
            self.unrecorded.add(segment_of(part.batch))

    def record(self, store: Store) -> None:
        """Write into the manifest what it lacks; it is still lacking after StoreError."""
        if self.unrecorded is None:
            store.record(self._plan, self.parts.values())
        else:
            parts = (self.parts[batch] for batch in batches_in(self.unrecorded) if batch in self.parts)
            store.record(self._plan, parts, self.unrecorded)
        self.unrecorded = set()

    def completed(self, samples: int) -> bool:
        """Return whether the rows of all the first ``samples`` samples are in the store."""
        while self._complete_prefix in self.parts:
            self._complete_prefix += 1
        return self._complete_prefix >= self._plan.batches_before(samples)

    def __len__(self) -> int:
        return len(self._again) + len(self._fresh)


class Window:
    """The calls in flight, in a limited number so that a lost worker or a cancelled campaign costs little.

    `batch_seconds` is how long one of the last batches took [s], None before the first.
    """

    def __init__(self, workers: Workers, address: CampaignAddress) -> None:
        self.worker_count = workers.count()
        self.batch_seconds: float | None = None
        self._workers = workers
        self._address = address
        self._in_flight: dict[Future[list[BatchResult]], list[BatchRequest]] = {}
        self._empty_since: float | None = None  # since when there has been no worker [s since 1970]
        self._warned_at = 0.0

    @property
    def batches(self) -> int:
        """Number of batches in flight."""
        return sum(map(len, self._in_flight.values()))

    @property
    def size(self) -> int:
        """Number of calls that may be in flight."""
        return CALLS_PER_WORKER * max(self.worker_count, 1)

    def __len__(self) -> int:
        return len(self._in_flight)

    def fill(self, queue: WorkQueue) -> None:
        """Submit batches until the window is full or the queue hands out no more."""
        while len(self) < self.size and (requests := self._next_requests(queue)):
            key = f"batch-{requests[0].batch:06d}"
            try:
                future = self._workers.submit(key, run_batches, self._address, requests)
            except NoWorkerLeft as error:
                raise CampaignError(
                    f"no worker has the build of clearcap that campaign {self._address.campaign_id} is planned for"
                    f" ({self._address.row_build or 'an earlier version'}); install that build on the workers, or plan"
                    " the campaign again with clearcap run"
                ) from error
            self._in_flight[future] = requests

    def next_finished(self, timeout: float) -> tuple[list[BatchRequest], Future[list[BatchResult]]] | None:
        """Wait for a call to finish; return its requests and its future, or None after ``timeout`` [s]."""
        future = self._workers.next_finished(timeout)
        return None if future is None else (self._in_flight.pop(future), future)

    def refuse(self, future: Future[list[BatchResult]]) -> str:
        """Submit no more batches to the worker in which a call failed; return its name, once for each worker."""
        return self._workers.refuse(future)

    def look(self, waiting: int) -> list[Wait]:
        """Count the workers and return what they wait for, with ``waiting`` batches not yet submitted; warn if none."""
        self.worker_count = self._workers.count()
        self._workers.expect(waiting + self.batches)
        waits = self._workers.waits()
        if self.worker_count:
            self._empty_since = None
            return waits
        now = time.time()
        if self._empty_since is None:
            self._empty_since = self._warned_at = now
        if now - self._warned_at > WARN_AFTER:
            logger.warning("%s has no workers; waiting for some to join it", self._workers.name)
            self._warned_at = now
        return [Wait("workers", self._empty_since), *waits]

    def _next_requests(self, queue: WorkQueue) -> list[BatchRequest]:
        """Return the requests of the next call: one batch, or several if no other workers need to wait.

        Several are short ones, or spare the scheduler of thousands of workers more calls than it can serve.
        """
        share = len(queue) // self.size
        seconds = max(CALL_SECONDS, self.worker_count / CALLS_PER_SECOND)
        fitting = 1 if self.batch_seconds is None else int(seconds / max(self.batch_seconds, 1e-3))
        most = max(min(fitting, share, LARGEST_CALL), 1)
        requests: list[BatchRequest] = []
        while len(requests) < most and (request := queue.next()) is not None:
            requests.append(request)
        return requests


def isolated(request: BatchRequest) -> BatchRequest:
    """Return the request for the next attempt at a batch that killed its worker."""
    if request.attempt >= TRIES:
        raise CampaignError(
            f"batch {request.batch} ended each of the {TRIES} workers that computed it, although its runs had a process"
            " of their own; look at the workers' logs and their memory, then resume"
        )
    return replace(request, attempt=request.attempt + 1, isolated=True)


class Losses:
    """How often the scheduler was lost with nothing computed in between, and the pauses before it is tried again.

    A scheduler that accepts the connection and is lost at once has not come back: only a finished call, or a connection
    that held for a while, ends a series of losses.
    """

    def __init__(self) -> None:
        self._since: float | None = None  # when the series began [s, monotonic]
        self._number = 0

    @property
    def seconds(self) -> float:
        """How long the series has lasted [s]."""
        return 0.0 if self._since is None else time.monotonic() - self._since

    def __bool__(self) -> bool:
        return self._since is not None

    def lose(self) -> float:
        """Count a loss and return the pause after it [s], each twice as long as the one before."""
        self._since = time.monotonic() if self._since is None else self._since
        self._number += 1
        first, longest = PAUSES
        # 20 doublings are far beyond the longest pause; an unlimited power would overflow in the end
        return min(first * 2.0 ** min(self._number - 1, 20), longest)

    def end(self) -> None:
        """Forget the losses: something has been computed, or the connection has held."""
        self._since, self._number = None, 0
