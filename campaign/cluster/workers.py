"""The interface through which a coordinator uses workers, wherever they run."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Protocol, TypeVar

from campaign.errors import CampaignError, UnreachableError

T = TypeVar("T")


class WorkerDied(CampaignError):
    """The process that ran a call ended before it answered, or hung; the message names it."""


class SchedulerLost(UnreachableError):
    """The connection to the workers is lost, and with it every call in flight."""


class NoWorkerLeft(CampaignError):
    """All workers are refused."""


class Workers(Protocol):
    """Processes that run calls of module-level functions.

    A finished call is a future that holds the result of the function, its exception, or `WorkerDied`.
    """

    @property
    def name(self) -> str:
        """Name of the place of the workers in messages."""

    def count(self) -> int:
        """Return the number of workers; raise SchedulerLost if the connection to them is lost."""

    def submit(self, key: str, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Have a worker call a module-level function, found there by its name, with small values that can be pickled.

        ``key`` is the name of the call on a scheduler's own pages. `next_finished` returns the future when it is
        finished. Raises SchedulerLost if the connection to the workers is gone, NoWorkerLeft if every worker is
        refused.
        """

    def next_finished(self, timeout: float | None = None) -> Future[Any] | None:
        """Wait for a call to finish and return it; None if none finished within ``timeout`` [s], or none is in flight.

        ``timeout`` None waits without limit. Raises SchedulerLost if the connection to the workers is gone,
        NoWorkerLeft if calls are waiting and every worker is refused.
        """

    def refuse(self, call: Future[Any]) -> str:
        """Submit no more calls to the worker in which this call failed; return the worker's name."""

    def cancel(self) -> None:
        """Cancel all calls in flight; their futures never finish."""
