"""The interface through which a coordinator uses workers, wherever they run, and has one compile for all."""

import logging
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Protocol, TypeVar

from campaign.compiling import announced_compilation
from campaign.errors import CampaignError, UnreachableError
from campaign.waits import Wait
from engine import missing_kernels, warm_up

ATTEMPTS = 3  # to load or compile the engine

logger = logging.getLogger(__name__)

T = TypeVar("T")


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
                    f"the engine could not be loaded or compiled: given to {error}, {attempt} times in a row; find"
                    " out what ends the workers (memory?), and try fewer: --workers N"
                ) from error
            logger.warning("loading the engine was given to %s; trying again", error)


def _result(workers: Workers, call: Callable[[], T]) -> T:
    """Return the result of a call in a worker."""
    future = workers.submit(call.__name__, call)
    workers.next_finished()
    return future.result()
