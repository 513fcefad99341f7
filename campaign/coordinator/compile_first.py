"""Have one worker of this machine compile the engine if needed, so that all others load the result."""

import logging
from collections.abc import Callable
from typing import TypeVar

from campaign.cluster.workers import WorkerDied, Workers
from campaign.compiling import announced_compilation
from campaign.errors import UnreachableError
from engine import missing_kernels, warm_up

logger = logging.getLogger(__name__)

ATTEMPTS = 3  # to load or compile the engine

T = TypeVar("T")


def compile_first(workers: Workers) -> None:
    """Have a worker compile the engine; if that worker dies, have another do it.

    If the engine is already compiled, nothing is done: every worker loads it with its first batch, all at the same
    time.

    Raises UnreachableError if several workers in a row die while they compile or load the engine.
    """
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
