"""Compile the engine, and log that this is being done; otherwise there would be no output for a minute."""

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from campaign.processes import meanwhile
from engine import missing_kernels, warm_up
from engine.platform.child import python_environment

logger = logging.getLogger(__name__)

LOOK_EVERY = 0.5  # s
SAY_EVERY = 15.0  # s
_announcing = threading.Lock()  # one announcer per process: estimating the run time opens a campaign in the same block


def compile_engine() -> None:
    """Compile everything that campaigns need, unless it is in the cache of compiled code; log this."""
    # Kernels compiled together share most of the work: one left for later takes one second here, ten in another
    # process.
    if missing := missing_kernels():
        with announced_compilation(missing):
            _compile_apart()


def _compile_apart() -> None:
    """Compile the engine in a process that ends then: the compiler's half a gigabyte would stay with this one."""
    words = [sys.executable, "-P", "-c", "import engine; engine.warm_up()"]
    done = subprocess.run(words, env=python_environment(), stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode:
        warm_up()  # here its error is seen


def load_engine() -> None:
    """Load, or compile, what runs need, so that this does not count as time of a run."""
    with announced_compilation(missing_kernels()):
        warm_up()


@contextmanager
def announced_compilation(missing: Sequence[str]) -> Iterator[None]:
    """Log during the block that the engine is compiled, once the first of the ``missing`` files is written."""
    if not missing or not _announcing.acquire(blocking=False):
        yield
        return
    try:
        with meanwhile(partial(_announce, missing, time.time()), "compiling"):
            yield
    finally:
        _announcing.release()


def _announce(missing: Sequence[str], start: float, over: threading.Event) -> None:
    """Log the elapsed time until ``over`` is set, once the first file has been written since the start."""
    said_at: float | None = None
    while not over.wait(LOOK_EVERY):
        if said_at is None and not any(_is_written(path, start) for path in missing):
            continue
        if said_at is not None and time.monotonic() - said_at < SAY_EVERY:
            continue
        if said_at is None:
            logger.info("compiling the engine, once for this version and this processor: half a minute or more")
        else:
            logger.info("compiling the engine: %.0f s so far", time.time() - start)
        said_at = time.monotonic()


def _is_written(path: str, start: float) -> bool:
    """Return whether a file was written since a time [s since 1970]; its timestamp may be in whole seconds."""
    try:
        return os.stat(path).st_mtime >= start - 1.0
    except OSError:
        return False
