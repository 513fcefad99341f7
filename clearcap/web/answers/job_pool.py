"""A pool of processes for jobs that need processor time, so that the server process stays responsive.

The processes are few, stay warm, and are replaced when a job exceeds its limits, ends its process, or is cancelled. No
library is used, because each job needs its own limits, each process an environment without the secrets of the service,
and answers must not be unpickled; the little that a library could still do is not worth the dependency.
"""

import asyncio
import json
import logging
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Any

from campaign.errors import CampaignError
from clearcap.web.answers.engine_warm_up import Compilation, EngineCompiling
from clearcap.web.answers.fair_queue import FairQueue, Quota
from clearcap.web.answers.job_limits import JobFailed, JobLimits, JobPostponed
from clearcap.web.answers.job_process import JobProcess

USUAL_PROCESSES = 2
logger = logging.getLogger(__name__)


class JobPool:
    """A pool of processes that compute one job each at a time; an asynchronous context manager in one event loop.

    Each process runs the job `warm_up`, such as `engine.warm_up`, before its first job. The job `is_compiled` returns
    whether that only loads compiled code; if it does not, one process compiles, and jobs are refused meanwhile.
    """

    def __init__(
        self,
        processes: int = USUAL_PROCESSES,
        quota: Quota = Quota(),  # noqa: B008  # it is immutable
        limits: JobLimits = JobLimits(),  # noqa: B008
        warm_up: Callable[[], Any] | None = None,
        is_compiled: Callable[[], bool] | None = None,
    ) -> None:
        self._limits = limits
        self._compilation = Compilation(warm_up, is_compiled)
        self._turns = FairQueue(processes, quota)
        self._count = processes
        self._idle: list[asyncio.Task[JobProcess]] = []  # last in, first out: its mapped columns may be used again
        self._all: set[asyncio.Task[JobProcess]] = set()

    async def __aenter__(self) -> "JobPool":
        """Start the processes, which warm up in the background."""
        for _ in range(self._count):
            self._start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        """Kill all processes, even in the middle of a job."""
        self._count = 0  # so that `_replace` starts no more
        for task in list(self._all):
            await self._end(task)

    @property
    def running(self) -> int:
        """Number of running jobs."""
        return self._turns.running

    @property
    def waiting(self) -> int:
        """Number of jobs waiting for their turn."""
        return self._turns.waiting

    @property
    def compiling_s(self) -> float | None:
        """Time that the engine has been compiling so far [s]; None if it is not being compiled."""
        return self._compilation.seconds

    @property
    def by_user(self) -> dict[str, tuple[int, int]]:
        """Numbers of running and of waiting jobs, for each user with jobs."""
        return self._turns.by_user

    async def run(self, user: str, job: Callable[..., Any], *arguments: Any, limits: JobLimits | None = None) -> bytes:
        """Compute a job in one of the processes when it is the user's turn; cancelling this call ends the job.

        The job is a module-level function. Its bytes are returned as they are, its plain data as JSON; numbers that are
        not finite are null. Raises Busy if too many jobs wait already. Its own error is raised as CampaignError, whose
        ``faults`` is None or the faults of an input as data. Raises JobFailed if it ended its process or has a bug, and
        a subclass if it exceeded its limits, could not start, waited too long, or the engine is being compiled.
        """
        if not self._count:  # nobody would ever give it a turn
            raise _shutting_down()
        async with self._turns.turn(user):
            task = self._take()
            try:
                process = await self._compilation.wait_warm(task)
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
            await self._compilation.warm(process)
        except BaseException:
            # shielded: cancelled again, this task would leave a process behind that nobody ends
            await asyncio.shield(process.end())
            raise
        return process

    def _take(self) -> "asyncio.Task[JobProcess]":
        """Take an idle process, preferably a warm one; processes that have ended are replaced first.

        Raises JobPostponed if there is no process, because the pool has ended.
        """
        for task in [task for task in self._idle if task.done() and not _is_alive(task)]:
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


def _is_alive(task: "asyncio.Task[JobProcess]") -> bool:
    """Return whether the process that a finished task has started is alive."""
    return not task.cancelled() and task.exception() is None and task.result().alive


def _shutting_down() -> JobPostponed:
    return JobPostponed("the server is shutting down; try again when it is back")
