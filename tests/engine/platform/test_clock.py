"""The clock of a process: it stops what takes too long, and nothing else."""

import os
import threading
import time

import numpy as np
import pytest

import engine.platform.clock
from engine.platform.clock import set_after
from tests.until import until

SOON = 0.05  # s


def flag() -> np.ndarray:
    """Return a flag that is not set."""
    return np.zeros(1, np.uint8)


def wait_for(one: np.ndarray) -> None:
    """Wait until a flag is set."""
    until(lambda: one[0], "the flag is not set", pause=1e-3)


def let_the_clock_look() -> None:
    """Have all limits told whose time has come."""
    other = flag()
    with set_after(-1e6, other, 1):  # before any other, so that the clock does not sleep on
        wait_for(other)


def test_a_block_that_takes_too_long_is_told():
    """And not before its time."""
    one, start = flag(), time.monotonic()
    with set_after(SOON, one, 3):
        wait_for(one)
        assert time.monotonic() - start >= SOON
    assert one[0] == 3


def test_a_block_that_is_over_is_left_alone(monkeypatch):
    """Also when its time has come."""
    one = flag()
    with set_after(3600.0, one, 3):
        let_the_clock_look()
    later = time.monotonic() + 7200.0
    monkeypatch.setattr(engine.platform.clock, "monotonic", lambda: later)
    let_the_clock_look()
    assert not one[0]


def test_a_flag_that_is_set_keeps_its_value():
    one = flag()
    one[0] = 2
    with set_after(0.0, one, 3):
        let_the_clock_look()
        assert one[0] == 2


@pytest.mark.parametrize("longest", [3600.0, 1e100, np.inf])
def test_a_shorter_limit_counts_while_a_longer_one_does(longest):
    """The clock sleeps until the end of a long limit; a block that begins later may have less time."""
    long, short = flag(), flag()
    with set_after(longest, long, 1):
        let_the_clock_look()
        with set_after(SOON, short, 1):
            wait_for(short)
        assert not long[0]


def test_many_blocks_have_one_thread():
    """Two hundred, one in the other or one after the other: one clock; each is told in its time."""
    flags = [flag() for _ in range(100)]
    for one in flags:
        with set_after(3600.0, one, 1):
            assert [thread.name for thread in threading.enumerate()].count("clock") == 1
    assert not any(one[0] for one in flags)
    together = [threading.Thread(target=_told_in_time, args=[one]) for one in flags]
    for thread in together:
        thread.start()
    for thread in together:
        thread.join()
    assert all(one[0] for one in flags)


def _told_in_time(one: np.ndarray) -> None:
    with set_after(SOON, one, 1):
        wait_for(one)


@pytest.mark.processes
@pytest.mark.parametrize("watched", [False, True])
def test_a_forked_process_has_a_clock_of_its_own(watched):
    """Also one that is forked while a block runs."""
    outer = flag()
    with set_after(3600.0 if watched else 0.0, outer, 1):
        child = os.fork()
        if child == 0:
            try:
                let_the_clock_look()
                os._exit(0)
            finally:
                os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
