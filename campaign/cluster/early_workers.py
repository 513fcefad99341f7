"""Workers of this machine that start while their campaign is still being planned."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from types import TracebackType

from campaign.cluster.cluster import Cluster
from campaign.cluster.dask_workers import connect_workers
from campaign.cluster.workers import Workers


class EarlyWorkers:
    """A context that starts workers early, in a thread, for the first `connect`, and ends them at its exit.

    Only processes of this machine start early; other workers are connected when needed.
    """

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._thread: threading.Thread | None = None
        self._started = ExitStack()
        self._workers: Workers | None = None
        self._error: Exception | None = None

    def __enter__(self) -> "EarlyWorkers":
        """Return this object; no worker is started yet."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        """End the workers if `connect` has not yielded them."""
        self._wait()
        self._started.close()

    def begin(self) -> None:
        """Start the workers without waiting for them, if they are processes of this machine."""
        if self._cluster.starts_here and self._thread is None:
            self._thread = threading.Thread(target=self._start, name="workers")
            self._thread.start()

    @contextmanager
    def connect(self, cluster: Cluster) -> Iterator[Workers]:
        """Yield the workers that started early, and end them with the block.

        If none started early, and at every further call, this is the same as `connect_workers`. It raises the same
        errors.
        """
        self._wait()
        error, self._error = self._error, None
        if error is not None:
            raise error
        workers, self._workers = self._workers, None
        if workers is None:
            with connect_workers(cluster) as connected:
                yield connected
            return
        with self._started.pop_all():
            yield workers

    def _start(self) -> None:
        """Start the workers; keep an error for `connect` to raise."""
        try:
            self._workers = self._started.enter_context(connect_workers(self._cluster))
        except Exception as error:
            self._error = error

    def _wait(self) -> None:
        """Wait until the workers have started or failed to start."""
        if self._thread is not None:
            self._thread.join()
