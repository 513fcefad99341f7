"""A coordinator whose workers are not there: what a batch costs it, how it grows, what it asks of the store.

The workers answer on a clock of their own, which jumps to the next answer, and write nothing; the coordinator, its
plan and its store are real, and each request to the store takes 20 ms, as on S3. So what is measured is the processor
time of the coordinator; what would pass meanwhile on the workers is simulated. A campaign of 1e8 samples has 200,000
batches: `python -m benchmarks.coordinator 200000 10000`.
"""

import heapq
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from hashlib import sha256
from typing import Any

import psutil

from benchmarks import ROOT
from campaign.coordinator.coordinate import RECORD_INTERVAL, RECORD_SHARE, Coordinator
from campaign.coordinator.dispatch import CALLS_PER_WORKER
from campaign.coordinator.lease import HEARTBEAT_INTERVAL
from campaign.coordinator.submit import submit
from campaign.plan import Plan
from campaign.spec.load import load_campaign
from campaign.store import Part, Store, open_store
from campaign.store.files.local import LocalFolder
from campaign.store.manifest import segment_of
from campaign.waits import Wait
from campaign.worker.messages import BatchRequest, BatchResult, CampaignAddress, Moments

SIZES = ((2_000, 1_000), (20_000, 10_000))  # numbers of batches and of workers
ROWS, SECONDS = 500, 10.0  # of a batch: rows, and how long a worker computes [s]
ANSWER = 0.02  # s for a request to the store
LISTED = 1000  # files in the answer to one request
RESUMED = 200  # parts that are there when a coordinator begins again


class SlowFolder(LocalFolder):
    """A folder whose requests take as long as those to an object store, and are counted."""

    def __init__(self, root: str, answer: float) -> None:
        super().__init__(root)
        self.requests, self._answer, self._asking = Counter[str](), answer, threading.local()

    def read(self, path: str, at_most: int) -> bytes:
        """Read a file."""
        return self._asked("read", super().read, path, at_most)

    def size(self, path: str) -> int:
        """Return the size of a file."""
        return self._asked("size", super().size, path)

    def sizes(self, path: str) -> dict[str, int]:
        """Return the sizes of the files in a folder."""
        return self._asked("list", super().sizes, path)

    def names(self, path: str) -> list[str]:
        """Return the names in a folder."""
        return self._asked("list", super().names, path)

    def write(self, path: str, content: bytes) -> None:
        """Write a file."""
        self._asked("write", super().write, path, content)

    def create(self, path: str, content: bytes) -> bool:
        """Write a file unless it exists."""
        return self._asked("write", super().create, path, content)

    def _asked(self, kind: str, ask: Callable[..., Any], *arguments: Any) -> Any:
        inner, pages = getattr(self._asking, "kind", ""), 1
        self._asking.kind = kind
        try:
            answer = ask(*arguments)
            pages = max(-(-len(answer) // LISTED), 1) if kind == "list" else 1
            return answer
        finally:  # that there is no such file is an answer too
            self._asking.kind = inner
            if not inner:  # a listing asks for sizes, which an object store sends with it
                self.requests[kind] += pages
                time.sleep(pages * self._answer)


class ClockedWorkers:
    """Workers that compute nothing: each call takes its time by a clock, which jumps from one answer to the next."""

    name = "workers on a clock"

    def __init__(self, count: int, responses: tuple[str, ...], seconds: float = SECONDS) -> None:
        self.now = 0.0  # s
        self._free = [0.0] * count  # when each worker is free
        self._moments = dict.fromkeys(responses, Moments(ROWS - 1, 1.0, 1.0))
        self._calls: list[tuple[float, int, Future[Any], list[BatchRequest]]] = []
        self.calls, self._seconds = 0, seconds

    def count(self) -> int:
        """Return the number of workers."""
        return len(self._free)

    def waits(self) -> list[Wait]:
        """Return nothing: no worker is missing."""
        return []

    def expect(self, calls: int) -> None:
        """Need no further workers."""

    def submit(self, key: str, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Give a call to the worker that is free first."""
        _, requests = arguments
        end = max(heapq.heappop(self._free), self.now) + self._seconds * len(requests)
        heapq.heappush(self._free, end)
        self.calls += 1
        future: Future[Any] = Future()
        heapq.heappush(self._calls, (end, self.calls, future, requests))
        return future

    def next_finished(self, timeout: float | None = None) -> Future[Any] | None:
        """Return the call that is finished next; the clock jumps there."""
        if not self._calls:
            return None
        self.now, number, future, requests = heapq.heappop(self._calls)
        future.worker = "host", number % self.count()  # type: ignore[attr-defined]  # any future takes attributes
        future.set_result([self._result(request.batch) for request in requests])
        return future

    def refuse(self, call: Future[Any]) -> str:
        """Refuse nobody."""
        return ""

    def cancel(self) -> None:
        """Forget the calls."""
        self._calls = []

    def _result(self, batch: int) -> BatchResult:
        part = Part(batch, ROWS, {"not_converged": 1, "ok": ROWS - 1}, 60_000, sha256(str(batch).encode()).hexdigest())
        return BatchResult(part, self._moments, seconds=self._seconds)


def measure() -> list[dict[str, Any]]:
    """Return what a coordinator takes for campaigns of some sizes, each in a process of its own."""
    return [measure_one(*size) for size in SIZES]


def measure_one(batches: int, workers: int) -> dict[str, Any]:
    """Return what a coordinator takes for a campaign; see `coordinate`."""
    command = [sys.executable, "-m", "benchmarks.coordinator", str(batches), str(workers)]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def coordinate(
    batches: int, workers: int, folder: str, resumed: int = RESUMED, answer: float = ANSWER
) -> dict[str, Any]:
    """Coordinate a campaign on workers by a clock; return times of the processor [s, us], memory [MiB] and requests."""
    store = open_store(folder)
    slow = store.files._backend = SlowFolder(folder, answer)
    taken: dict[str, float] = {}
    with _timed(taken, "plan_s"):
        plan = submit(store, load_campaign("c60", samples=batches * ROWS), ROWS, tries_runs=False)
    with _timed(taken, "start_s"):
        coordinator = Coordinator(store, plan, "", lambda _: None)
    before, asked = _memory_mib(), slow.requests.total()
    on_clock = ClockedWorkers(workers, tuple(plan.mechanism.responses))
    with _timed(taken, "dispatch_s"):
        coordinator.compute(on_clock)
    memory, requests = _memory_mib(), slow.requests.total() - asked
    with _timed(taken, "look_s"):
        coordinator._look_at_store()
    asked = slow.requests.total()
    coordinator._look_at_store()
    of_look = slow.requests.total() - asked
    with _timed(taken, "record_s"):
        store.record(plan, coordinator.queue.parts.values())
    # between two records: those that were finished, among those that were given out
    given = min(int(workers * (RECORD_INTERVAL / SECONDS + CALLS_PER_WORKER)), batches)
    coordinator.queue.unrecorded = set(map(segment_of, range(batches - given, batches)))
    asked = slow.requests.total()
    with _timed(taken, "record_new_s"):
        coordinator.queue.record(store)
    of_record = slow.requests.total() - asked
    busy = taken["dispatch_s"] / on_clock.now + taken["look_s"] / HEARTBEAT_INTERVAL
    return {
        "batches": batches,
        "workers": workers,
        "plan_s": taken["plan_s"],
        "start_s": taken["start_s"],
        "batch_us": 1e6 * taken["dispatch_s"] / batches,
        "look_ms": 1e3 * taken["look_s"],
        "record_s": taken["record_s"],
        "record_new_s": taken["record_new_s"],
        "memory_MiB": memory,
        "batch_bytes": 2**20 * (memory - before) / batches,
        "requests": requests,
        "requests_a_look": of_look,
        "requests_a_record": of_record,
        "simulated_s": on_clock.now,
        "calls_a_s": on_clock.calls / on_clock.now,  # simulated, of the scheduler
        # share of one core that the coordinator takes while the workers compute
        "busy": busy + min(taken["record_new_s"] / RECORD_INTERVAL, RECORD_SHARE),
        **_resume(store, plan, slow, resumed),
    }


def _resume(store: Store, plan: Plan, slow: SlowFolder, parts: int) -> dict[str, Any]:
    """Return what each part costs a coordinator that begins again, of so many."""
    from campaign.worker.batch import run_batch
    from tests.campaign.fake_engine import simulate

    address = CampaignAddress.of(store, plan, simulate)
    store.record(plan, [])  # or a coordinator would ask for all the parts that nobody has written
    for batch in range(parts):
        run_batch(address, BatchRequest(batch))
    taken: dict[str, float] = {}
    asked, start = slow.requests.total(), time.perf_counter()
    with _timed(taken, "resume_s"):
        coordinator = Coordinator(store, plan, "", lambda _: None)
    wall = time.perf_counter() - start
    assert len(coordinator.queue.parts) == parts
    return {
        "resumed": parts,
        "part_ms": 1e3 * taken["resume_s"] / parts,
        "part_wall_ms": 1e3 * wall / parts,
        "requests_a_part": (slow.requests.total() - asked) / parts,
    }


def _memory_mib() -> float:
    return float(psutil.Process().memory_info().rss) / 2**20


@contextmanager
def _timed(taken: dict[str, float], name: str) -> Iterator[None]:
    """Note the processor time of a block [s]."""
    start = time.process_time()
    yield
    taken[name] = time.process_time() - start


def main() -> None:
    """Print what a coordinator takes; the arguments are the numbers of batches and of workers."""
    with tempfile.TemporaryDirectory(prefix="clearcap-bench-") as folder:
        print(json.dumps(coordinate(int(sys.argv[1]), int(sys.argv[2]), folder)))


if __name__ == "__main__":
    main()
