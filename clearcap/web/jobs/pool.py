"""A pool of processes for jobs that need processor time, so that the server process stays responsive.

The processes are few, stay warm, and are replaced when a job exceeds its limits, ends its process, or is cancelled. No
library is used, because each job needs its own limits, each process an environment without the secrets of the service,
and answers must not be unpickled; the little that a library could still do is not worth the dependency.
"""

import asyncio
import json
import logging
import math
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

from campaign.errors import CampaignError
from clearcap.web.jobs.process import JobFailed, JobLimits, JobPostponed, JobProcess

_USUAL_JOB = 1.0  # s; assumed duration of a job before one has ended
_MEMORY = 0.2  # weight of the last job in the mean duration of a job


class Busy(CampaignError):
    """A user, or all users together, have as many jobs waiting as is allowed; `retry_after_s` is at least 1."""

    def __init__(self, message: str, retry_after_s: int) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


@dataclass(frozen=True)
class Quota:
    """Limits on the number of jobs at a time."""

    at_once: int = 2  # running jobs of a user
    waiting: int = 16  # waiting jobs of a user
    waiting_in_all: int = 200  # waiting jobs of all users


@dataclass
class _UserJobs:
    """The jobs of one user: the number of running ones, and the waiting ones."""

    running: int = 0
    waiting: "deque[asyncio.Future[None]]" = field(default_factory=deque)


class FairQueue:
    """Give turns to the jobs of users, in one event loop; `places` jobs run at the same time."""

    def __init__(self, places: int, quota: Quota) -> None:
        self._free, self._places, self._quota = places, places, quota
        self._users: dict[str, _UserJobs] = {}  # in the order in which their turn comes
        self._job_s = _USUAL_JOB

    @property
    def waiting(self) -> int:
        """Number of waiting jobs."""
        return sum(len(jobs.waiting) for jobs in self._users.values())

    @property
    def running(self) -> int:
        """Number of running jobs."""
        return self._places - self._free

    @property
    def by_user(self) -> dict[str, tuple[int, int]]:
        """Numbers of running and of waiting jobs, for each user with jobs."""
        return {user: (jobs.running, len(jobs.waiting)) for user, jobs in self._users.items()}

    @asynccontextmanager
    async def turn(self, user: str) -> AsyncIterator[None]:
        """Wait for a user's turn and hold it while the block runs; raise Busy if too many jobs are waiting already."""
        jobs = self._users.setdefault(user, _UserJobs())
        ready = asyncio.get_running_loop().create_future()
        if self._free == 0 or jobs.running >= self._quota.at_once:
            self._check_room(user, jobs)
        jobs.waiting.append(ready)
        self._give()
        try:
            await ready
        except asyncio.CancelledError:
            if not ready.cancelled():  # the turn was given at the same moment
                self._leave(user, jobs)
            elif ready in jobs.waiting:
                jobs.waiting.remove(ready)
                self._forget_idle(user, jobs)
            raise
        begun = monotonic()
        try:
            yield
        finally:
            self._job_s += _MEMORY * (monotonic() - begun - self._job_s)
            self._leave(user, jobs)

    def _check_room(self, user: str, jobs: _UserJobs) -> None:
        """Raise Busy if no further job may wait."""
        mine, all_jobs = len(jobs.waiting), self.waiting
        if mine < self._quota.waiting and all_jobs < self._quota.waiting_in_all:
            return
        at_a_time = self._places if mine < self._quota.waiting else min(self._places, self._quota.at_once)
        queue = all_jobs if mine < self._quota.waiting else mine
        seconds = max(1, math.ceil(queue * self._job_s / at_a_time))
        self._forget_idle(user, jobs)
        whose = f"{mine} jobs of {user} wait" if mine >= self._quota.waiting else f"{all_jobs} jobs wait"
        limit = self._quota.waiting if mine >= self._quota.waiting else self._quota.waiting_in_all
        raise Busy(f"{whose}, as many as may (limit {limit}); try again in {seconds} s", seconds)

    def _give(self) -> None:
        """Give the free places to users in rotation; a user who gets one becomes the last."""
        while self._free:
            may = (u for u, jobs in self._users.items() if jobs.waiting and jobs.running < self._quota.at_once)
            user = next(may, None)
            if user is None:
                return
            jobs = self._users[user]
            ready = jobs.waiting.popleft()
            if ready.cancelled():  # the job was cancelled a moment ago
                self._forget_idle(user, jobs)
                continue
            self._users[user] = self._users.pop(user)
            jobs.running += 1
            self._free -= 1
            ready.set_result(None)

    def _leave(self, user: str, jobs: _UserJobs) -> None:
        """Take back a place; its user becomes the last in the rotation."""
        jobs.running -= 1
        self._free += 1
        self._users[user] = self._users.pop(user)
        self._forget_idle(user, jobs)
        self._give()

    def _forget_idle(self, user: str, jobs: _UserJobs) -> None:
        """Drop a user without jobs."""
        if not jobs.running and not jobs.waiting:
            self._users.pop(user, None)


TO_WARM_UP = JobLimits(processor_s=600.0, wall_s=900.0)  # the engine may have to be compiled
USUAL_S = 30.0  # s that compiling takes on a dedicated machine
LEAST_S = 5.0  # s after which users are asked to try again
logger = logging.getLogger(__name__)


class EngineCompiling(JobPostponed):
    """A job cannot run yet, because the engine is being compiled; ask again after `retry_after_s`."""

    def __init__(self, seconds: float) -> None:
        self.retry_after_s = math.ceil(max(USUAL_S - seconds, LEAST_S))
        super().__init__(
            "the engine is being compiled for this machine, once after each update: half a minute or more,"
            f" {seconds:.0f} s so far; ask again in {self.retry_after_s} s"
        )


class Compilation:
    """Warm processes up by a job, so that only one compiles; another says whether the compiled code is there."""

    def __init__(self, warm_up: Callable[[], Any] | None, is_compiled: Callable[[], bool] | None) -> None:
        self._warm_up, self._is_compiled = warm_up, is_compiled
        self._one = asyncio.Lock()
        self._begun = asyncio.Event()
        self._since: float | None = None

    @property
    def seconds(self) -> float | None:
        """Time that the engine has been compiling so far [s]; None if it is not being compiled."""
        since = self._since
        return None if since is None else monotonic() - since

    async def warm(self, process: JobProcess) -> None:
        """Warm a process up; if that compiles the engine, `seconds` tells meanwhile for how long."""
        if self._warm_up is None:
            return
        if not await self._loads_only(process):
            async with self._one:
                if not await self._loads_only(process):  # no other process has compiled it meanwhile
                    self._since = start = monotonic()
                    self._begun.set()
                    logger.info(
                        "compiling the engine, once for this version and this processor: half a minute or more; until"
                        " then pages that compute ask their readers to wait"
                    )
                    try:
                        await process.ask(self._warm_up, (), TO_WARM_UP)
                    finally:
                        self._since = None
                        self._begun.clear()
                    logger.info("the engine is compiled, after %.0f s", monotonic() - start)
                    return
        await process.ask(self._warm_up, (), TO_WARM_UP)

    async def wait_warm(self, task: "asyncio.Task[JobProcess]") -> JobProcess:
        """Return the process that a task warms up; raise EngineCompiling if compiling keeps it from being warm yet."""
        if task.done():
            return await task
        begun = asyncio.create_task(self._begun.wait())
        try:
            await asyncio.wait({task, begun}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            begun.cancel()
        seconds = self.seconds
        if not task.done() and seconds is not None:
            raise EngineCompiling(seconds)
        return await asyncio.shield(task)  # the pool keeps the process if this caller leaves

    async def _loads_only(self, process: JobProcess) -> bool:
        return self._is_compiled is None or await process.ask(self._is_compiled, (), TO_WARM_UP) == b"true"


USUAL_PROCESSES = 2


class JobPool:
    """A pool of processes that compute one job each at a time, after the job `warm_up`; see `Compilation`."""

    def __init__(
        self,
        processes: int = USUAL_PROCESSES,
        quota: Quota = Quota(),
        limits: JobLimits = JobLimits(),  # noqa: B008
        warm_up: Callable[[], Any] | None = None,
        is_compiled: Callable[[], bool] | None = None,
    ) -> None:
        self._limits = limits
        self.compilation = Compilation(warm_up, is_compiled)
        self.turns = FairQueue(processes, quota)
        self._count = processes
        self._idle: list[asyncio.Task[JobProcess]] = []  # last in, first out: its mapped columns may be used again
        self._all: set[asyncio.Task[JobProcess]] = set()

    async def __aenter__(self) -> "JobPool":
        """Start the processes, which warm up in the background."""
        for _ in range(self._count):
            self._start()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Kill all processes, even in the middle of a job."""
        self._count = 0  # so that `_replace` starts no more
        for task in list(self._all):
            await self._end(task)

    async def run(self, user: str, job: Callable[..., Any], *arguments: Any, limits: JobLimits | None = None) -> bytes:
        """Compute a job, a module-level function, when it is the user's turn; cancelling this call ends the job.

        Its bytes are returned as they are, its plain data as JSON with null for what is not finite. Its own error is
        raised as CampaignError, whose ``faults`` is None or the faults of an input as data; others are `JobFailed`.
        """
        if not self._count:  # nobody would ever give it a turn
            raise _shutting_down()
        async with self.turns.turn(user):
            task = self._take()
            try:
                process = await self.compilation.wait_warm(task)
            except (asyncio.CancelledError, EngineCompiling) as error:
                me = asyncio.current_task()
                if task.cancelled() and not (me and me.cancelling()):  # by the end of the pool, not by who asked
                    raise _shutting_down() from error
                self._idle.append(task)  # the process goes on warming up for the next job
                raise
            except (CampaignError, OSError) as error:
                self._replace(task)
                raise JobPostponed(f"no process could be started for it: {error}; try again later") from error
            try:
                content = await process.ask(job, arguments, limits or self._limits)
            except JobFailed as error:
                logger.warning("a job of %s (%s) failed: %s", user, job.__name__, error)
                await self._end(task)
                self._replace(task)
                raise
            except CampaignError:
                self._idle.append(task)
                raise
            except BaseException:
                # an answer that still comes would be taken for that of the next job, so the process is ended, shielded
                # from a second cancellation
                await asyncio.shield(self._end(task))
                self._replace(task)
                raise
            self._idle.append(task)
            return content

    async def data(self, user: str, job: Callable[..., Any], *arguments: Any, limits: JobLimits | None = None) -> Any:
        """Return the plain data of a job; see `run`."""
        return json.loads(await self.run(user, job, *arguments, limits=limits))

    def _start(self) -> None:
        """Start a process that becomes idle; jobs that get it wait until it is warm."""
        task = asyncio.get_running_loop().create_task(self._warm_process())
        self._all.add(task)
        self._idle.append(task)

    async def _warm_process(self) -> JobProcess:
        """Start a process, warm it up and return it."""
        process = await JobProcess.start()
        try:
            await self.compilation.warm(process)
        except BaseException:
            # shielded: cancelled again, this task would leave a process behind that nobody ends
            await asyncio.shield(process.end())
            raise
        return process

    def _take(self) -> "asyncio.Task[JobProcess]":
        """Take an idle process, preferably a warm one; processes that have ended are replaced first."""
        for task in [task for task in self._idle if task.done()]:
            if task.cancelled() or task.exception() is not None or not task.result().alive:
                self._idle.remove(task)
                self._replace(task)
        if not self._idle:
            raise _shutting_down()
        warm = next((task for task in reversed(self._idle) if task.done()), self._idle[-1])
        self._idle.remove(warm)
        return warm

    def _replace(self, task: "asyncio.Task[JobProcess]") -> None:
        """Replace a process that has ended by a new one, unless the pool has ended."""
        self._all.discard(task)
        if self._count:
            self._start()

    async def _end(self, task: "asyncio.Task[JobProcess]") -> None:
        """End a process, even one that is still warming up."""
        task.cancel()
        with suppress(asyncio.CancelledError, CampaignError, OSError):
            await (await task).end()


def _shutting_down() -> JobPostponed:
    return JobPostponed("the server is shutting down; try again when it is back")
