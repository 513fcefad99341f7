"""Close the HTTP server that dask starts with each scheduler and worker, because it has no authentication.

Dask's settings ``distributed.scheduler.preload`` and ``distributed.worker.preload`` name this module.
"""

from typing import Any


def dask_setup(service: Any) -> None:
    """Stop listening for HTTP; dask calls this when a scheduler or a worker starts."""
    service.http_server.stop()
