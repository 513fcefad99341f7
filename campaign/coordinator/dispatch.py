"""Dispatch batches to workers, and keep as many in flight as the workers can use."""

import logging
import time
from concurrent.futures import Future
from dataclasses import replace

from campaign.cluster.workers import NoWorkerLeft, Workers
from campaign.coordinator.backoff import TRIES
from campaign.coordinator.work_queue import WorkQueue
from campaign.errors import CampaignError
from campaign.worker.batch import run_batches
from campaign.worker.messages import BatchRequest, BatchResult, CampaignAddress

logger = logging.getLogger(__name__)

CALLS_PER_WORKER = 3  # in flight: one runs, one waits at the worker, one at the scheduler
CALL_SECONDS = 0.5  # s; the most that batches sent in one call may take: dask spends milliseconds on each call
LARGEST_CALL = 20  # batches
WARN_AFTER = 60.0  # s without a worker


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
        self._idle_since: float | None = None

    @property
    def size(self) -> int:
        """Number of calls that may be in flight."""
        return CALLS_PER_WORKER * max(self.worker_count, 1)

    def __len__(self) -> int:
        return len(self._in_flight)

    def fill(self, queue: WorkQueue) -> None:
        """Submit batches until the window is full or the queue hands out no more.

        Raises SchedulerLost if the connection to the workers is lost, CampaignError if every worker runs another build.
        """
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
        """Submit no more batches to the worker in which a call failed; return the worker's name."""
        return self._workers.refuse(future)

    def count_workers(self) -> int:
        """Count the workers; if there are none, warn every minute. Raise SchedulerLost if the connection is lost."""
        self.worker_count = self._workers.count()
        now = time.monotonic()
        self._idle_since = None if self.worker_count else (self._idle_since or now)
        if self._idle_since is not None and now - self._idle_since > WARN_AFTER:
            logger.warning("%s has no workers; waiting for some to join it", self._workers.name)
            self._idle_since = now
        return self.worker_count

    def _next_requests(self, queue: WorkQueue) -> list[BatchRequest]:
        """Return the requests of the next call: one batch, or several short ones if no other workers need to wait."""
        share = len(queue) // self.size
        fitting = 1 if self.batch_seconds is None else int(CALL_SECONDS / max(self.batch_seconds, 1e-3))
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
