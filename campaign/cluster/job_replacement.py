"""Jobs of a batch system: those that end are replaced, whatever ended them, and their number follows the work.

dask-jobqueue (0.9) submits each job once. Its adaptive scaling notices a lost job only if a worker of it had joined,
and not by name where a job has several workers; a job that ends before it starts a worker, or that waits in the queue
for ever, it never sees. So the queue itself is asked. A batch system that does not answer proves nothing: then all jobs
count as alive.

Nor can dask know how much work there is: it counts the calls that it holds, and the coordinator gives it only a few for
each worker, so that few are lost with a worker. So the coordinator says how many calls are to come, and there are as
many workers, between two limits. Jobs that are not needed any more are ended: first those that wait in the queue, then
those whose workers have nothing to do.
"""

import getpass
import json
import logging
import math
import re
import subprocess
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distributed import Scheduler, SchedulerPlugin, Status

from campaign.cluster.cluster import Cluster
from campaign.errors import UnreachableError
from campaign.waits import Wait, counted

logger = logging.getLogger(__name__)

CHECK_INTERVAL = 10.0  # s; the commands of a busy batch system take seconds, and its admins count them
VISIBLE_WITHIN = 30.0  # s after its submission a job has been in the queue, whatever the batch system caches
ANSWER_WITHIN = 60.0  # s
MOST_IN_VAIN = 5  # times in a row that jobs end before a worker of theirs has joined
LONGEST_PAUSE = 300.0  # s before a job is submitted after some that ended in vain
PENDING_AFTER = 60.0  # s after which it is said why a job waits
LAST_LINES = 5  # of the log of a job
MOST_IDS = 6  # of jobs in one message

# the words of SLURM, OAR and PBS
_WAITING = ("PENDING", "CONFIGURING", "REQUEUED", "WAITING", "HOLD", "TOACKRESERVATION", "TOLAUNCH", "Q", "H", "W", "T")
_PBS_ENDED = ("C", "F", "X")  # completed, finished, subjob expired: these stay in the table for a while


@dataclass(frozen=True)
class QueuedJob:
    """What a batch system says of a job that has not ended."""

    state: str  # in its own words: ``PENDING``, ``Running``, ``Q``
    reason: str = ""  # why it waits; empty if it runs, or if the batch system does not say

    @property
    def waits(self) -> bool:
        """Whether the job has not begun."""
        return self.state.upper() in _WAITING


def _slurm(answer: str) -> dict[str, QueuedJob]:
    """Return the jobs in lines of ``squeue``: id, state and reason, apart by ``|``."""
    fields = (line.strip().split("|", 2) for line in answer.splitlines() if line.count("|") >= 2)
    return {job: QueuedJob(state, "" if reason == "None" else reason) for job, state, reason in fields}


def _oar(answer: str) -> dict[str, QueuedJob]:
    """Return the jobs in the JSON of ``oarstat``, which says nothing at all where there are none."""
    jobs: dict[str, Any] = json.loads(answer) if answer.strip() else {}
    kept = {job: entry for job, entry in jobs.items() if entry["state"] not in ("Terminated", "Error")}
    # mostly the message repeats what was asked for, R=1,W=0:2:0, and no reason
    said = {job: str(entry.get("message") or "") for job, entry in kept.items()}
    return {job: QueuedJob(kept[job]["state"], "" if each.startswith("R=") else each) for job, each in said.items()}


def _pbs(answer: str) -> dict[str, QueuedJob]:
    """Return the jobs in the table of ``qstat -s``: id first, state last but one, a comment below a job that waits."""
    jobs: dict[str, QueuedJob] = {}
    last = ""
    for line in answer.splitlines():
        row = line.split()
        if re.match(r"\d+", line) and len(row) > 2:
            last = row[0]
            if row[-2] not in _PBS_ENDED:
                jobs[last] = QueuedJob(row[-2])
        elif line[:1].isspace() and line.strip(" -") and last in jobs and jobs[last].waits:
            jobs[last] = QueuedJob(jobs[last].state, line.strip())
    return jobs


# the command, to which the user's name is added, and the reader of its answer
_QUEUES: dict[str, tuple[tuple[str, ...], Callable[[str], dict[str, QueuedJob]]]] = {
    "slurm": (("squeue", "--noheader", "--format=%i|%T|%r", "--user"), _slurm),
    "oar": (("oarstat", "--json", "--user"), _oar),
    "pbs": (("qstat", "-s", "-u"), _pbs),
}


def queued_jobs(kind: str) -> dict[str, QueuedJob] | None:
    """Return this user's jobs that have not ended, by the number in their id; None if the batch system does not say."""
    command, read = _QUEUES[kind]
    try:
        words = [*command, getpass.getuser()]
        done = subprocess.run(words, capture_output=True, text=True, timeout=ANSWER_WITHIN, check=True)
        return {number(job): entry for job, entry in read(done.stdout).items()}
    except (OSError, subprocess.SubprocessError, ValueError, KeyError, TypeError) as error:
        logger.info("%s: %s", " ".join(command), error)
        return None


def number(job: str) -> str:
    """Return the number in the id of a job: PBS appends the name of its server, and some commands shorten that."""
    found = re.match(r"\d+", job)
    return found[0] if found else job


def last_lines(kind: str, job: str) -> str:
    """Return the last lines of a job's log, and how it ended, as far as the batch system says so."""
    if kind != "slurm":
        return ""
    try:
        words = ["scontrol", "show", "job", "--oneliner", job]
        said = subprocess.run(words, capture_output=True, text=True, timeout=ANSWER_WITHIN, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return ""
    facts = dict(re.findall(r"(\w+)=(\S+)", said))
    ending = f"{facts.get('JobState', 'ended')}, exit code {facts.get('ExitCode', 'unknown')}"
    try:
        log = Path(facts.get("StdErr") or facts.get("StdOut") or "").read_text(errors="replace").splitlines()
    except OSError:
        log = []
    return "; ".join([ending, *log[-LAST_LINES:]])


def _jobs(ids: list[str]) -> str:
    return f"job {ids[0]}" if len(ids) == 1 else f"jobs {_ids(ids)}"


def _ids(ids: list[str]) -> str:
    """Return the first ids of jobs, and how many more there are."""
    return ", ".join(ids[:MOST_IDS]) + (f" and {len(ids) - MOST_IDS} more" if len(ids) > MOST_IDS else "")


class JobReplacement:
    """Keep as many jobs of a `dask_jobqueue` cluster queued or running as there is work for.

    ``released`` are the names of workers that were ended because nothing was left for them. ``failure`` is what ended
    it all: jobs that end in vain, again and again, or a batch system that refuses new ones.
    """

    def __init__(
        self,
        jobs: Any,
        cluster: Cluster,
        queue: Callable[[str], dict[str, QueuedJob] | None] = queued_jobs,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.failure: UnreachableError | None = None
        self.released: set[str] = set()
        self._jobs, self._kind, self._queue, self._clock = jobs, cluster.kind, queue, clock
        self._limits = (cluster.least or 1, cluster.most or 1)  # of the number of workers
        self._workers = self._limits[0]  # that there is work for
        self._waiting: dict[str, QueuedJob] = {}  # in the last answer of the queue, by name
        self._changed = threading.Event()
        self._ids: dict[str, str] = {}  # of the last job of each name
        self._since: dict[str, float] = {}  # when each name's job was first seen [s]
        self._queued: set[str] = set()  # names whose present job has been in the queue
        self._joined: set[str] = set()  # names of all workers that have joined since their present job is known
        self._in_vain = 0
        self._calls = self._fruitless = 0  # calls to come; times in a row that jobs ended and there were not fewer
        self._not_before = 0.0  # when the next job may be submitted [s]
        self._told: dict[str, str] = {}  # id of each waiting job and the reason that was said
        self._known(clock())

    def worker_joined(self, name: str) -> None:
        """Take note of a worker of a job; the workers of one job are numbered."""
        self._joined.add(name)

    def expect(self, calls: int) -> None:
        """Have as many workers as there are calls to come, between the two limits."""
        if calls < self._calls:
            self._fruitless = 0
        self._calls = calls
        least, most = self._limits
        before, self._workers = self._workers, min(max(calls, least), most)
        if before != self._workers:
            self._changed.set()

    def wait(self, seconds: float) -> None:
        """Wait for the next check: at most so long, and no longer once the number of workers is to change."""
        if self._changed.wait(seconds):
            self._changed.clear()

    def wake(self) -> None:
        """End a wait."""
        self._changed.set()

    def waits(self) -> list[Wait]:
        """Return which jobs wait in the queue, and why, as far as the batch system says so."""
        waiting = dict(self._waiting)
        if not waiting:
            return []
        now = self._clock()
        longest = max(now - self._since.get(name, now) for name in waiting)
        return [Wait("jobs", time.time() - longest, _by_reason({self._ids.get(n, n): e for n, e in waiting.items()}))]

    def check(self) -> None:
        """Compare the jobs with the queue and the work once; submit those that are missing, and end the others."""
        queued = self._queue(self._kind)
        now = self._clock()
        present = self._known(now)
        # dask forgets a job whose worker is gone
        missing = [name for name in list(self._jobs.worker_spec) if name in self._ids and name not in present]
        if queued is not None:
            waiting = {name: queued[number(job)] for name, job in present.items() if number(job) in queued}
            self._waiting = {name: entry for name, entry in waiting.items() if entry.waits}
            self._tell_waiting(now)
            gone = {name for name, job in present.items() if number(job) not in queued}
            self._queued |= present.keys() - gone
            missing += [name for name in gone if name in self._queued or now - self._since[name] > VISIBLE_WITHIN]
        if missing:
            self._count(missing, now)
        self._follow_work()
        if self.failure is None and self._ended and now >= self._not_before:
            self._submit()
            self._known(now)

    def _follow_work(self) -> None:
        spec, least = self._jobs.worker_spec, self._limits[0]
        each = max((len(self._workers_of(name)) for name in spec), default=1)
        wanted = math.ceil(max(self._workers, least) / each)
        while len(spec) < wanted:
            spec.update(self._jobs.new_worker_spec())
            self.released.difference_update(self._workers_of(list(spec)[-1]))
        if len(spec) > wanted:
            self._jobs.sync(self._end_some, len(spec) - wanted)

    async def _end_some(self, most: int) -> None:
        """End some jobs without work; called in the loop of the scheduler, which gives out no calls meanwhile."""
        busy = {str(worker.name) for worker in self._jobs.scheduler.workers.values() if worker.processing}
        free = [name for name in self._jobs.worker_spec if not busy.intersection(self._workers_of(name))]
        # those without a job, then those that wait in the queue, then those whose workers have nothing to do
        free.sort(key=lambda name: (name in self._jobs.workers, name not in self._waiting))
        chosen = free[:most]
        if not chosen:
            return
        workers = [worker for name in chosen for worker in self._workers_of(name)]
        self.released.update(workers)
        await self._jobs.scheduler.retire_workers(names=workers, close_workers=True)
        ids = [self._ids.pop(name) for name in chosen if name in self._ids]
        for name in chosen:
            self._waiting.pop(name, None)
            del self._jobs.worker_spec[name]
        await self._jobs._correct_state()
        if ids:
            logger.info("%s ended: fewer batches are left than workers", _jobs(ids))

    def _workers_of(self, name: str) -> list[str]:
        return [f"{name}{suffix}" for suffix in self._jobs.worker_spec[name].get("group", [""])]

    def _known(self, now: float) -> dict[str, str]:
        """Return the id of each name's job, and forget what was known of the one before it."""
        present = {name: str(job.job_id) for name, job in list(self._jobs.workers.items()) if job.job_id}
        new = [name for name, job in present.items() if self._ids.get(name) != job]
        for name in new:
            self._ids[name], self._since[name] = present[name], now
            self._queued.discard(name)
        if new:
            logger.info("%s submitted", _jobs([present[name] for name in new]))
        return present

    @property
    def _ended(self) -> list[str]:
        return [name for name in list(self._jobs.worker_spec) if name not in self._jobs.workers]

    def _has_joined(self, name: str) -> bool:
        """Return whether a job has had a worker, and forget it."""
        workers = {each for each in list(self._joined) if each == name or each.startswith(f"{name}-")}
        self._joined -= workers
        return bool(workers)

    def _count(self, names: list[str], now: float) -> None:
        """Forget the jobs that have ended, and count how often in a row none of them has had a worker."""
        # Times, not jobs, are counted: all jobs that wait may be cancelled at once, and that is no reason to give up.
        ended = {name: self._ids.pop(name) for name in names}
        for name in names:
            if forgotten := self._jobs.workers.pop(name, None):
                forgotten.status = Status.closed  # what dask's cluster expects of its jobs when it is closed
        worked = [job for name, job in ended.items() if self._has_joined(name)]
        in_vain = [job for job in ended.values() if job not in worked]
        if worked:
            self._in_vain = 0
            logger.warning("%s ended, and will be replaced", _jobs(worked))
            self._fruitless += 1
            if self._fruitless == MOST_IN_VAIN:
                logger.warning(
                    "%d times in a row jobs ended, and no batch was finished meanwhile: have jobs last longer"
                    " (walltime, --lifetime), or batches be smaller (--batch-size)",
                    MOST_IN_VAIN,
                )
        if not in_vain:
            return
        self._in_vain += not worked
        said = last_lines(self._kind, in_vain[-1])
        why = f" (the last one: {said})" if said else ""
        logger.warning("%s ended before a worker had joined%s", _jobs(in_vain), why)
        self._not_before = now + min(CHECK_INTERVAL * 2.0 ** max(self._in_vain - 1, 0), LONGEST_PAUSE)
        if self._in_vain >= MOST_IN_VAIN:
            self.failure = UnreachableError(
                f"--cluster {self._kind}: {MOST_IN_VAIN} times in a row jobs ended before a worker had joined, at last"
                f" {_jobs(in_vain)}{why}; see the logs of these jobs"
            )

    def _submit(self) -> None:
        try:
            self._jobs.sync(self._jobs._correct_state)
        except (RuntimeError, OSError) as error:
            for job in self._jobs.workers.values():
                if job.job_id is None:
                    job.status = Status.failed
            self.failure = UnreachableError(f"--cluster {self._kind}: the batch system refused a job: {error}")

    def _tell_waiting(self, now: float) -> None:
        """Say of the jobs that wait for long why they do, and again when the reason changes."""
        news = {}
        for name, entry in self._waiting.items():
            job = self._ids[name]
            if now - self._since[name] >= PENDING_AFTER and self._told.get(job) != entry.reason:
                self._told[job], news[job] = entry.reason, entry
        if news:
            logger.warning("%s waiting in the queue: %s", counted(len(news), "job"), _by_reason(news))


def _by_reason(waiting: dict[str, QueuedJob]) -> str:
    reasons: dict[str, list[str]] = defaultdict(list)
    for job, entry in waiting.items():
        reasons[entry.reason or entry.state].append(job)
    return "; ".join(f"{_jobs(ids)}: {reason}" for reason, ids in reasons.items())


class _Joins(SchedulerPlugin):
    """Tells of each worker that joins a scheduler: one may have left again at the next check."""

    def __init__(self, replacement: JobReplacement) -> None:
        self._replacement = replacement

    def add_worker(self, scheduler: Scheduler, worker: str) -> None:
        """Tell the name of a worker at an address."""
        self._replacement.worker_joined(str(scheduler.workers[worker].name))


@contextmanager
def jobs_replaced(jobs: Any, cluster: Cluster, interval: float = CHECK_INTERVAL) -> Iterator[JobReplacement]:
    """Replace the jobs that end while the block runs; if that fails, end the cluster, and raise UnreachableError."""
    replacement, ended = JobReplacement(jobs, cluster), threading.Event()
    jobs.scheduler.add_plugin(_Joins(replacement))

    def watch() -> None:
        while True:
            replacement.wait(interval)
            if ended.is_set():
                return
            try:
                replacement.check()
            except Exception:  # the next check may do better; rows are computed meanwhile
                if not ended.is_set():
                    logger.exception("jobs could not be checked")
            if replacement.failure is not None:
                jobs.close()  # so that the coordinator stops waiting for workers
                return

    thread = threading.Thread(target=watch, name="job replacement", daemon=True)
    thread.start()
    try:
        yield replacement
    finally:
        ended.set()
        replacement.wake()
        thread.join()
        if replacement.failure is not None:
            raise replacement.failure
