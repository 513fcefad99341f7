"""Ctrl-C ends a command with status 130, also where the exception that it raises is swallowed."""

import os
import signal
import sys
import threading
import time

import pytest

from campaign import interrupts
from campaign.interrupts import INTERRUPTED, exit_at_interrupt


class Swallowing:
    """What meets Ctrl-C where no exception can pass, as in a callback of compiled code."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)


@pytest.fixture(autouse=True)
def usual_handler():
    """Have the handler of a fresh Python; the block leaves Ctrl-C ignored, as the process is to end."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for thread in threading.enumerate():  # an interrupt sent twice comes once more, while it is ignored
        if isinstance(thread, threading.Timer):
            thread.join()
    signal.signal(signal.SIGINT, before)


def ends(capsys):
    """Let a swallowed Ctrl-C end a block; return what it printed."""

    def work():
        thing = Swallowing()
        del thing
        time.sleep(20.0)
        pytest.fail("it goes on as if nothing had come")

    with pytest.raises(SystemExit) as ending, exit_at_interrupt():
        work()
    assert ending.value.code == INTERRUPTED
    return capsys.readouterr().err


def test_swallowed_interrupt_is_raised_again(capsys):
    """It comes again shortly after, and one line says why the command ends."""
    assert ends(capsys) == "clearcap: interrupted\n"


def test_second_interrupt_while_the_first_is_reported(capsys, monkeypatch):
    """An exception in the hook for swallowed ones would be lost, and a traceback printed: it is raised after it."""
    within = []

    def interrupted(number, send=interrupts.send_again):
        if not within:
            within.append(number)
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)
        send(number)

    monkeypatch.setattr(interrupts, "send_again", interrupted)
    hook = sys.unraisablehook
    assert ends(capsys) == "clearcap: interrupted\n"
    assert within == [signal.SIGINT]
    assert sys.unraisablehook is hook
