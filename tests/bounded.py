"""No test waits for ever: one that hangs is interrupted where it waits, so that it fails and says where that is."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

SECONDS = 1200.0  # of a test, and of what it cleans up: on a busy machine several processes compile the engine at once
SLOW_SECONDS = 2400.0  # of a slow one, and of what a test needs


@contextmanager
def bounded(what: str, seconds: float = SECONDS) -> Iterator[None]:
    """Raise TimeoutError in the main thread, which runs this block, if the block is not over in time."""

    def interrupt(*_: object) -> None:
        raise TimeoutError(f"{what}: not over within {seconds:g} s")

    before = signal.signal(signal.SIGUSR1, interrupt)
    timer = threading.Timer(seconds, signal.pthread_kill, (threading.main_thread().ident, signal.SIGUSR1))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        signal.signal(signal.SIGUSR1, before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    """Bound what a test needs."""
    with bounded(f"what {item.nodeid} needs", SLOW_SECONDS):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Bound a test."""
    with bounded(item.nodeid, SLOW_SECONDS if item.get_closest_marker("slow") else SECONDS):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item):
    """Bound what is cleaned up after a test."""
    with bounded(f"what follows {item.nodeid}"):
        return (yield)
