"""The clock of a process: it stops what takes too long, and nothing else."""

import os
import threading
import time

import numpy as np
import pytest

from engine.clock import set_after

SOON = 0.05  # s


def flag() -> np.ndarray:
    """Return a flag that is not set."""
    return np.zeros(1, np.uint8)


def waited(one: np.ndarray, seconds: float = 2.0) -> float:
    """Wait until a flag is set; return how long that took [s]."""
    start = time.monotonic()
    while not one[0] and time.monotonic() - start < seconds:
        time.sleep(1e-3)
    return time.monotonic() - start


def test_a_block_that_takes_too_long_is_told():
    one = flag()
    with set_after(SOON, one, 3):
        assert not one[0]
        assert SOON * 0.9 < waited(one) < 1.0
    assert one[0] == 3


def test_a_block_that_is_over_is_left_alone():
    one = flag()
    with set_after(SOON, one, 3):
        pass
    time.sleep(2 * SOON)
    assert not one[0]


def test_a_flag_that_is_set_keeps_its_value():
    one = flag()
    with set_after(0.0, one, 3):
        one[0] = 2
        time.sleep(SOON)
        assert one[0] in (2, 3)
    one[0] = 2
    with set_after(0.0, one, 3):
        time.sleep(SOON)
        assert one[0] == 2


@pytest.mark.parametrize("longest", [60.0, 1e100, np.inf])
def test_a_shorter_limit_counts_while_a_longer_one_does(longest):
    """The clock sleeps until the end of a long limit; a block that begins later may have less time."""
    long, short = flag(), flag()
    with set_after(longest, long, 1):
        time.sleep(SOON)
        with set_after(SOON, short, 1):
            assert waited(short) < 1.0
        assert not long[0]


def test_many_blocks_have_one_thread():
    """Two hundred, one in the other or one after the other: one clock; each is told in its time."""
    with set_after(60.0, flag(), 1):
        threads = threading.active_count()
    flags = [flag() for _ in range(100)]
    for one in flags:
        with set_after(60.0, one, 1):
            assert threading.active_count() == threads
    assert not any(one[0] for one in flags)
    together = [threading.Thread(target=_told_in_time, args=[one]) for one in flags]
    for thread in together:
        thread.start()
    for thread in together:
        thread.join()
    assert all(one[0] for one in flags)


def _told_in_time(one: np.ndarray) -> None:
    with set_after(SOON, one, 1):
        assert waited(one) < 1.5


@pytest.mark.parametrize("watched", [False, True])
def test_a_forked_process_has_a_clock_of_its_own(watched):
    """Also one that is forked while a block runs."""
    outer = flag()
    with set_after(60.0 if watched else 0.0, outer, 1):
        child = os.fork()
        if child == 0:
            one = flag()
            with set_after(SOON, one, 1):
                took = waited(one)
            os._exit(0 if one[0] and took < 1.5 else 1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
