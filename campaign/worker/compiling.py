"""Say that the engine is being compiled, when it is: without that, minutes without a sign of life."""

import logging
import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

logger = logging.getLogger(__name__)

LOOK_EVERY = 0.5  # s
SAY_EVERY = 15.0  # s
_announcing = threading.Lock()  # one voice a process: what estimates the time of a run opens a campaign meanwhile


@contextmanager
def announced_compilation(missing: Sequence[str]) -> Iterator[None]:
    """While the block runs, log that the engine is compiled, and for how long, from the first kernel that is written.

    Parameters
    ----------
    missing : sequence of str
        Files that compiling writes, see `engine.missing_kernels`; where none is missing, nothing is logged. Nor is it
        in a block within such a block.
    """
    if not missing or not _announcing.acquire(blocking=False):
        yield
        return
    over = threading.Event()
    thread = threading.Thread(target=_announce, args=(missing, time.time(), over), name="compiling", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        _announcing.release()


def _announce(missing: Sequence[str], start: float, over: threading.Event) -> None:
    """Log how long it takes, from the first file that was written since the start, until it is over."""
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
    """Return whether a file was written since a time [s since 1970], which the clock of its disk may count in full."""
    try:
        return os.stat(path).st_mtime >= start - 1.0
    except OSError:
        return False
