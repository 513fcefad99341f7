"""Close the HTTP server that dask starts with each scheduler and worker, because it has no authentication.

Dask's settings ``distributed.scheduler.preload`` and ``distributed.worker.preload`` name this module.
"""

import logging
from typing import Any


def dask_setup(service: Any) -> None:
    """Stop listening for HTTP; dask calls this when a scheduler or a worker starts."""
    service.http_server.stop()
    # when a worker process ends, dask's thread that listens to the nanny may find its pipe gone, and log a traceback
    logging.getLogger("distributed.nanny").setLevel(logging.CRITICAL)
