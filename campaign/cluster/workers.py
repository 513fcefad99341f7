"""What a coordinator asks of the processes that compute, wherever these are."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Protocol, TypeVar

from campaign.errors import CampaignError, UnreachableError

T = TypeVar("T")


class WorkerDied(CampaignError):
    """The process that was given a call ended before it answered, or hung; the message names it."""


class SchedulerLost(UnreachableError):
    """The connection to the workers is gone, and with it every call in flight."""


class NoWorkerLeft(CampaignError):
    """All workers are refused."""


class Workers(Protocol):
    """Processes that run calls of functions of modules.

    A finished call is a future with the result of the function, its exception, or `WorkerDied`.
    """

    @property
    def name(self) -> str:
        """What messages call the workers' place."""

    def count(self) -> int:
        """Return the number of workers.

        Raises
        ------
        SchedulerLost
            If the connection to them is gone.
        """

    def submit(self, key: str, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Have a worker call a function.

        Parameters
        ----------
        key : str
            What a scheduler's own pages call it.
        function : callable
            A function of a module; workers find it by its name.
        *arguments
            Small values that can be pickled.

        Returns
        -------
        Future
            Unfinished; `next_finished` returns it when it is finished.

        Raises
        ------
        SchedulerLost
            If the connection to the workers is gone.
        NoWorkerLeft
            If every worker is refused.
        """

    def next_finished(self, timeout: float | None = None) -> Future[Any] | None:
        """Wait for a call that is finished and return it.

        Parameters
        ----------
        timeout : float or None
            How long to wait [s]; None for as long as it takes.

        Returns
        -------
        Future or None
            None if none finished in time, or none is in flight.

        Raises
        ------
        SchedulerLost
            If the connection to the workers is gone.
        NoWorkerLeft
            If calls wait and every worker is refused.
        """

    def refuse(self, call: Future[Any]) -> str:
        """Give no more calls to the worker in which this call failed; return the worker's name."""

    def cancel(self) -> None:
        """Take back all calls in flight; their futures are never finished."""
