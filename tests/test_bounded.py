"""A test that hangs is interrupted; one that does not is left alone."""

import asyncio
import queue
import signal
import subprocess
import sys
import threading

import pytest

from tests.bounded import bounded


def wait_for_a_thread():
    threading.Event().wait()


def wait_for_a_queue():
    queue.SimpleQueue().get()


def wait_for_a_loop():
    asyncio.run(asyncio.Event().wait())


def wait_for_a_process():
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        try:
            process.stdout.readline()
        finally:
            process.kill()


@pytest.mark.processes
@pytest.mark.parametrize("wait", [wait_for_a_thread, wait_for_a_queue, wait_for_a_loop, wait_for_a_process])
def test_what_waits_is_interrupted(wait):
    with pytest.raises(TimeoutError, match=r"the answer: not over within 0\.1 s"), bounded("the answer", 0.1):
        wait()


def test_what_is_over_in_time_is_not():
    """Nothing is left of the bound: no thread, no other way to take the signal."""
    threads, before = {*threading.enumerate()}, signal.getsignal(signal.SIGUSR1)
    with bounded("nothing", 60.0):
        assert signal.getsignal(signal.SIGUSR1) is not before
    assert not {*threading.enumerate()} - threads  # one of an earlier test may end meanwhile
    assert signal.getsignal(signal.SIGUSR1) is before


def test_the_inner_bound_comes_first():
    """And the outer one holds on."""

    def wait_twice():
        with pytest.raises(TimeoutError, match="inner"), bounded("inner", 0.1):
            wait_for_a_thread()
        wait_for_a_thread()

    with pytest.raises(TimeoutError, match="outer"), bounded("outer", 1.0):
        wait_twice()
