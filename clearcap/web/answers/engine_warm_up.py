"""Compilation of the engine when the server starts: one process compiles while users are asked to try again later."""

import asyncio
import logging
import math
from collections.abc import Callable
from time import monotonic
from typing import Any

from clearcap.web.answers.job_limits import JobLimits, JobPostponed
from clearcap.web.answers.job_process import JobProcess

TO_WARM_UP = JobLimits(processor_s=600.0, wall_s=900.0)  # the engine may have to be compiled
USUAL_S, LEAST_S = (
    30.0,
    5.0,
)  # s that compiling takes on a dedicated machine; shortest time after which users are asked to try again [s]
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
    """Warm processes up so that only one of them compiles the engine and the others load the compiled code.

    Both arguments are jobs: `warm_up` compiles and loads the engine (None: no process needs it), and `is_compiled`
    returns whether warming up will only load compiled code (None: nothing is ever compiled).
    """

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
        """Warm a process up; raise the errors of `JobProcess.ask`."""
        if self._warm_up is None:
            return
        if not await self._loads_only(process):
            async with self._one:
                if not await self._loads_only(process):  # no other process has compiled it meanwhile
                    await self._compile(process, self._warm_up)
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

    async def _compile(self, process: JobProcess, warm_up: Callable[[], Any]) -> None:
        """Compile the engine and log it; meanwhile, `seconds` returns the time so far."""
        self._since = start = monotonic()
        self._begun.set()
        logger.info(
            "compiling the engine, once for this version and this processor: half a minute or more; until then pages"
            " that compute ask their readers to wait"
        )
        try:
            await process.ask(warm_up, (), TO_WARM_UP)
        finally:
            self._since = None
            self._begun.clear()
        logger.info("the engine is compiled, after %.0f s", monotonic() - start)
