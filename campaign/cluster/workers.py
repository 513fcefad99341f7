"""The workers that a coordinator uses, as an interface, and those of a dask cluster, watched for liveness.

No other module submits work to dask.
"""

import logging
import math
import os
import secrets
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Protocol, TypeVar, cast

import distributed
from distributed import Client, KilledWorker, get_worker
from distributed.scheduler import heartbeat_interval

from campaign.cluster.cluster import Cluster
from campaign.cluster.connect import connect
from campaign.cluster.job_replacement import JobReplacement
from campaign.compiling import announced_compilation
from campaign.errors import CampaignError, UnreachableError
from campaign.processes import ProcessName
from campaign.store.files.retry_policy import outages_told
from campaign.waits import LONGEST_DETAIL, Wait, counted
from engine import missing_kernels, warm_up

ATTEMPTS = 3  # to load or compile the engine
ANSWERS_WITHIN = 30.0  # s for the scheduler to answer, and for the result of a finished call to arrive
SILENT_AFTER = 60.0  # s without a heartbeat, after which a worker is taken to hang
MISSED = 3  # heartbeats that it may miss at least: of 10,000 workers dask wants one every 51 s
GONE_AFTER = 150.0  # s without any worker of this machine; longer than a worker takes to start
RETURNS_WITHIN = 8.0  # s for a killed worker to be replaced
LOOK_INTERVAL = 2.0  # s between two checks for silent workers
SEEN_FOR = 1.0  # s for which a look at the workers counts: one at 10,000 takes scheduler and client 0.3 s each
RETRY_INTERVAL = 0.5  # s between two checks for a worker that is not refused
_OUTAGES = "clearcap-store"  # topic of what workers say of the store
REMEMBERED = 300.0  # s for which a lost worker is told of, unless it comes back before
MOST_HOSTS = 4  # named in one message
logger = logging.getLogger(__name__)
T = TypeVar("T")
Who = tuple[str, str]  # name and host of a worker


class WorkerDied(CampaignError):
    """The process that ran a call ended before it answered, or hung; the message names it."""


class SchedulerLost(UnreachableError):
    """The connection to the workers is lost, and with it every call in flight."""


class NoWorkerLeft(CampaignError):
    """All workers are refused."""


class Workers(Protocol):
    """Processes that run calls; a finished call is a future with the function's result, its error, or `WorkerDied`."""

    @property
    def name(self) -> str:
        """Name of the place of the workers in messages."""

    def count(self) -> int:
        """Return the number of workers that are not refused; raise SchedulerLost if the connection is lost."""

    def waits(self) -> list[Wait]:
        """Return what is known of workers that are missing: jobs that wait in a queue, and lost workers."""

    def expect(self, calls: int) -> None:
        """Say how many calls are still to come, including those in flight; a batch system's jobs may follow that."""

    def submit(self, key: str, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Have a worker call a module-level function with small values; ``key`` names the call on a scheduler's pages.

        Raises SchedulerLost, and NoWorkerLeft if every worker is refused, as `next_finished` does.
        """

    def next_finished(self, timeout: float | None = None) -> Future[Any] | None:
        """Wait for a call to finish; None if none does within ``timeout`` [s], if any, or none is in flight."""

    def refuse(self, call: Future[Any]) -> str:
        """Submit no more calls to the worker in which this one failed; return its name, empty if refused before."""

    def cancel(self) -> None:
        """Cancel all calls in flight; their futures never finish."""


def compile_first(workers: Workers) -> None:
    """Have one worker compile the engine, if it is not compiled; if that worker dies, another."""
    for attempt in range(1, ATTEMPTS + 1):
        try:
            if missing := _result(workers, missing_kernels):
                with announced_compilation(missing):
                    _result(workers, warm_up)
            return
        except WorkerDied as error:
            if attempt == ATTEMPTS:
                raise UnreachableError(
                    f"the engine could not be loaded or compiled, {attempt} times in a row, last by {error}; find"
                    " out what ends the workers (memory?), and try fewer: --workers N"
                ) from error
            logger.warning("loading the engine was given to %s; trying again", error)


def _result(workers: Workers, call: Callable[[], T]) -> T:
    future = workers.submit(call.__name__, call)
    workers.next_finished()
    return future.result()


# -- workers of dask ---------------------------------------------------------------------------------------------------


@contextmanager
def connect_workers(cluster: Cluster) -> Iterator[Workers]:
    """Start or reach a cluster and yield its workers; raises the same errors as `campaign.cluster.connect.connect`."""
    with connect(cluster) as (client, jobs):
        yield DaskWorkers(client, jobs, started_here=cluster.starts_here)


class DaskWorkers:
    """The workers that a dask client reaches; ``jobs`` are those of a batch system that have them."""

    def __init__(self, client: Client, jobs: JobReplacement | None = None, *, started_here: bool = False) -> None:
        self._client, self._jobs = client, jobs
        self._roster = Roster()
        self._started_here = started_here
        self._token = secrets.token_hex(8)  # distinguishes its keys from those of other clients of the scheduler
        self._submitted = 0
        self._refused: set[str] = set()
        self._in_flight: dict[str, tuple[distributed.Future[Any], Future[Any]]] = {}
        self._finished: SimpleQueue[distributed.Future[Any]] = SimpleQueue()
        self._liveness = Liveness(SILENT_AFTER)
        self._looked_at = time.monotonic()
        self._seen: tuple[float, dict[str, float]] = -math.inf, {}  # when, and what, by `_heartbeats`
        self._silent: set[str] = set()
        self._looks_without = 0  # successive checks that found no worker
        self._outages: dict[str, Wait] = {}  # of the store, as workers meet them, by the worker's address
        client.subscribe_topic(_OUTAGES, self._note_outage)

    @property
    def name(self) -> str:
        """The scheduler and its address."""
        return f"scheduler {self._client.scheduler_info(n_workers=0)['address']}"

    def count(self) -> int:
        """Return the number of workers that the scheduler knows and that are not refused."""
        return len(self._seen_lately().keys() - self._refused)

    def waits(self) -> list[Wait]:
        """Return the store's refusals, the jobs that wait in a queue, and the workers lost in the last minutes."""
        refusals = sorted(self._outages.values(), key=lambda wait: wait.since)[:1]
        return [*refusals, *(self._jobs.waits() if self._jobs else []), *self._roster.waits()]

    def _note_outage(self, event: tuple[float, Any]) -> None:
        """Note what a worker says of the store: that it refuses, and why, or that it answers again."""
        _, (worker, fault) = event
        if fault:
            self._outages.setdefault(worker, Wait("store", time.time(), fault[:LONGEST_DETAIL]))
        else:
            self._outages.pop(worker, None)

    def expect(self, calls: int) -> None:
        """Have a batch system's jobs follow the number of calls, if their number may vary."""
        if self._jobs:
            self._jobs.expect(calls)
            self._roster.release(self._jobs.released)

    def submit(self, key: str, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Submit a call to the scheduler; refused workers do not get it."""
        accepted = self._accepted()
        self._submitted += 1
        task = self._client.submit(
            _call,
            function,
            *arguments,
            key=f"{key}-{self._token}-{self._submitted}",
            pure=False,
            workers=accepted,
            allow_other_workers=accepted is not None,  # a restarted worker has another address
        )
        future: Future[T] = Future()
        self._in_flight[str(task.key)] = task, future
        task.add_done_callback(self._finished.put)
        return future

    def next_finished(self, timeout: float | None = None) -> Future[Any] | None:
        """Wait for a call to finish and return it; its result is released from the cluster."""
        end = None if timeout is None else time.monotonic() + timeout
        while self._in_flight:
            self._look()
            left = LOOK_INTERVAL if end is None else end - time.monotonic()
            try:
                task = self._finished.get(timeout=max(min(left, LOOK_INTERVAL), 0.0))
            except Empty:
                if left <= LOOK_INTERVAL and end is not None:
                    return None
                continue
            _, future = self._in_flight.pop(str(task.key))
            self._finish(future, task)
            task.release()
            return future
        return None

    def refuse(self, call: Future[Any]) -> str:
        """Submit no more calls to the worker in which this call failed; return its address, only the first time."""
        worker = str(getattr(call.exception(), "worker", ""))
        if worker in self._refused:
            return ""
        self._refused.add(worker)
        return worker

    def cancel(self) -> None:
        """Cancel all calls in flight; a worker still completes the call that it is running."""
        if self._in_flight and self._client.status == "running":
            self._client.cancel([task for task, _ in self._in_flight.values()], force=True)
        self._in_flight, self._finished = {}, SimpleQueue()

    def _accepted(self) -> list[str] | None:
        """Return the workers that are not refused, waiting a while for one; None if none is refused."""
        if not self._refused:
            return None
        end = time.monotonic() + RETURNS_WITHIN
        while not (accepted := self._addresses() - self._refused):
            if time.monotonic() > end:
                raise NoWorkerLeft(f"{self.name} has only workers that are refused")
            time.sleep(RETRY_INTERVAL)
        return sorted(accepted)

    def _addresses(self) -> set[str]:
        return set(self._heartbeats())

    def _heartbeats(self) -> dict[str, float]:
        """Return the time of each worker's last heartbeat, by the scheduler's clock."""
        if self._client.status != "running":
            raise SchedulerLost(f"client {self._client.status}")
        scheduler: Any = self._client.scheduler
        try:
            known = self._client.sync(scheduler.identity, n_workers=-1, callback_timeout=ANSWERS_WITHIN)["workers"]
        except (OSError, TimeoutError) as error:
            raise SchedulerLost(f"the scheduler does not answer ({str(error) or type(error).__name__})") from error
        present = {a: (str(w.get("name", a)), str(w.get("host", a))) for a, w in known.items()}
        self._roster.look(present, self._refused)
        for gone in self._outages.keys() - known.keys():
            self._outages.pop(gone, None)
        heartbeats = {address: float(worker["last_seen"]) for address, worker in known.items()}
        self._seen = time.monotonic(), heartbeats
        return heartbeats

    def _seen_lately(self) -> dict[str, float]:
        """Return what `_heartbeats` returned a moment ago, or returns now."""
        at, heartbeats = self._seen
        is_fresh = self._client.status == "running" and time.monotonic() - at < SEEN_FOR
        return heartbeats if is_fresh else self._heartbeats()

    def _look(self) -> None:
        """Look for silent workers and have them replaced, at most every two seconds."""
        now = time.monotonic()
        if now - self._looked_at < LOOK_INTERVAL:
            return
        self._looked_at = now
        heartbeats = self._seen_lately()
        self._looks_without = 0 if heartbeats else self._looks_without + 1
        if self._started_here and self._looks_without * LOOK_INTERVAL > GONE_AFTER:
            raise SchedulerLost("all workers of this machine are gone, and none returns")
        for worker in self._liveness.look(heartbeats, now):
            logger.warning(
                "worker %s sends no heartbeat for %.0f s: it hangs and is replaced; its batches are computed again",
                worker,
                self._liveness.longest(len(heartbeats)),
            )
            self._silent.add(worker)
            self._replace(worker)

    def _replace(self, worker: str) -> None:
        """Have the scheduler end a worker, or drop it if its nanny hangs as well; do not wait for that."""
        loop, scheduler = cast(Any, (self._client.loop, self._client.scheduler))
        options = {"wait_for_workers": False, "on_error": "return", "timeout": ANSWERS_WITHIN}
        loop.add_callback(scheduler.restart_workers, workers=[worker], stimulus_id=f"silent-{worker}", **options)

    def _finish(self, future: Future[Any], task: "distributed.Future[Any]") -> None:
        """Give a future the result or the error of a dask task."""
        if task.status == "cancelled":
            # not by this class, whose `cancel` forgets its calls: dask cancels them when the connection is lost
            raise SchedulerLost("connection closed")
        try:
            answer = task.result(timeout=ANSWERS_WITHIN)
            if isinstance(answer, Answered):  # not by a worker of an earlier version
                future.worker = answer.worker  # type: ignore[attr-defined]  # any future takes attributes
            future.set_result(answer.result if isinstance(answer, Answered) else answer)
        except TimeoutError as error:
            raise SchedulerLost("a finished call sends no result") from error
        except KilledWorker as error:
            hung = error.last_worker.address in self._silent
            future.set_exception(WorkerDied("a worker that hung" if hung else "a worker that ended"))
        except Exception as error:
            future.set_exception(error)


@dataclass(frozen=True)
class Answered:
    """What a call on a worker returned."""

    result: Any
    worker: ProcessName


def worker_of(call: Future[Any]) -> ProcessName | None:
    """Return the process in which a finished call ran; None if it is not known."""
    found: ProcessName | None = getattr(call, "worker", None)
    return found


def _call(function: Callable[..., Any], *arguments: Any) -> Answered:
    """Call a function on a worker, whose address its error gets; tell at once of a store that refuses for minutes."""
    worker = get_worker()

    def tell(fault: str) -> None:
        worker.log_event(_OUTAGES, (str(worker.address), fault))

    try:
        with outages_told(tell):
            return Answered(function(*arguments), (socket.gethostname(), os.getpid()))
    except Exception as error:
        tell("")
        error.worker = str(worker.address)  # type: ignore[attr-defined]  # any exception takes attributes
        raise


class Liveness:
    """Which workers have sent no heartbeat for ``at_least`` seconds, or longer, because they hang or were stopped.

    The time without one is counted only while this process is awake: a check adds at most twice the interval between
    checks. If a laptop sleeps or all processes of a campaign are stopped, no worker is to blame.
    """

    def __init__(self, at_least: float) -> None:
        self._at_least = at_least
        self._heartbeats: dict[str, float] = {}
        self._silent_for: dict[str, float] = {}
        self._looked_at: float | None = None

    def longest(self, workers: int) -> float:
        """Return how long one of so many workers may send no heartbeat [s]."""
        return max(self._at_least, MISSED * heartbeat_interval(workers))

    def look(self, heartbeats: Mapping[str, float], now: float) -> list[str]:
        """Return the workers silent at a monotonic time [s], and count anew; only heartbeats that change count."""
        passed = 0.0 if self._looked_at is None else min(now - self._looked_at, 2.0 * LOOK_INTERVAL)
        self._looked_at = now
        self._silent_for = {
            worker: self._silent_for.get(worker, 0.0) + passed if self._heartbeats.get(worker) == last else 0.0
            for worker, last in heartbeats.items()
        }
        self._heartbeats = dict(heartbeats)
        longest = self.longest(len(heartbeats))
        silent = [worker for worker, seconds in self._silent_for.items() if seconds >= longest]
        self._silent_for.update(dict.fromkeys(silent, 0.0))
        return silent


class PrestartedWorkers:
    """Workers of this machine that start while their campaign is still planned, and last for all calls of `connect`."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._has_begun = False
        self._starting: Future[Workers] | None = None  # until the first `connect`
        self._started = ExitStack()
        self._workers: Workers | None = None

    def __enter__(self) -> "PrestartedWorkers":
        return self

    def __exit__(self, *error: object) -> None:
        wait([self._starting] if self._starting else [])
        self._workers = None
        self._started.close()

    def begin(self) -> None:
        """Start the workers without waiting for them, if they are processes of this machine."""
        if self._cluster.starts_here and not self._has_begun:
            self._has_begun, pool = True, ThreadPoolExecutor(1, "workers")
            self._starting = pool.submit(lambda: self._started.enter_context(connect_workers(self._cluster)))
            pool.shutdown(wait=False)

    @contextmanager
    def connect(self, cluster: Cluster) -> Iterator[Workers]:
        """Yield the workers that are there, or connect to some; those whose block ended with an error are ended."""
        if self._starting:
            wait([self._starting])  # before it is forgotten, as Ctrl-C may come meanwhile
            starting, self._starting = self._starting, None
            self._workers = starting.result()
        workers, self._workers = self._workers, None
        with ExitStack() as until_lost:
            until_lost.push(self._started.pop_all())
            if workers is None:
                workers = until_lost.enter_context(connect_workers(cluster))
            yield workers
            self._workers, self._started = workers, until_lost.pop_all()


# -- who has joined or is lost since the last look, said once, and remembered for a while ------------------------------


class Roster:
    """The workers of a scheduler by address, and those that are lost; the first look only takes note of them."""

    def __init__(self) -> None:
        self._known: dict[str, Who] | None = None
        self._released: set[str] = set()  # names of workers that are not needed any more
        self._lost: dict[Who, float] = {}  # and when that was seen [s since 1970]

    def look(self, present: Mapping[str, Who], refused: Iterable[str]) -> None:
        """Compare with the last look, and log who has joined, restarted, or is lost; ``refused`` are not counted."""
        known, self._known = self._known, dict(present)
        if known is None or known == present:
            return
        joined = [who for address, who in present.items() if address not in known]
        gone = [who for address, who in known.items() if address not in present]
        left = len(present.keys() - set(refused))
        restarted = set(joined) & set(gone)
        new, lost = ([who for who in those if who not in restarted] for those in (joined, gone))
        lost = [who for who in lost if who[0] not in self._released]
        for who in joined:
            self._lost.pop(who, None)
        self._lost |= dict.fromkeys(lost, time.time())
        if restarted:
            logger.info("%s restarted", _named(sorted(restarted)))
        if new:
            logger.info("%s joined, %d now", _named(new), left)
        if lost:
            logger.warning("%s %s lost, %d left", _named(lost), "is" if len(lost) == 1 else "are", left)

    def release(self, names: Iterable[str]) -> None:
        """Take note of workers that end because nothing is left for them; nobody needs to hear of that."""
        self._released = set(names)

    def waits(self) -> list[Wait]:
        """Return the workers that were lost in the last minutes and are not back."""
        now = time.time()
        self._lost = {who: at for who, at in self._lost.items() if now - at < REMEMBERED}
        if not self._lost:
            return []
        return [Wait("lost", max(self._lost.values()), _named(sorted(self._lost)))]


def _named(workers: list[Who]) -> str:
    """Return workers in words: one by its name, several by their hosts."""
    if len(workers) == 1:
        name, host = workers[0]
        return f"worker {name} on {host}"
    hosts = Counter(host for _, host in workers).most_common()
    places = [f"{count} on {host}" for host, count in hosts[:MOST_HOSTS]]
    places += [f"the others on {counted(len(hosts) - MOST_HOSTS, 'host')}"] if len(hosts) > MOST_HOSTS else []
    return f"{counted(len(workers), 'worker')} ({', '.join(places)})"
