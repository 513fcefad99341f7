"""Ctrl-C ends a command with status 130, also where the exception that it raises is swallowed."""

import signal
import sys
import time

import pytest

from campaign import interrupts
from campaign.interrupts import INTERRUPTED, exit_at_interrupt


class Swallowing:
    """What meets Ctrl-C where no exception can pass, as in a callback of compiled code."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


@pytest.fixture(autouse=True)
def usual_handler():
    """Have the handler of a fresh Python; the block leaves Ctrl-C ignored, as the process is to end."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def ends(capsys, comes_again):
    """Let a swallowed Ctrl-C that comes again end a block; return what it printed."""

    def work():
        thing = Swallowing()
        del thing
        comes_again()
        pytest.fail("it goes on as if nothing had come")

    with pytest.raises(SystemExit) as ending, exit_at_interrupt():
        work()
    assert ending.value.code == INTERRUPTED
    return capsys.readouterr().err


def test_swallowed_interrupt_is_raised_again(capsys):
    """It comes again shortly after, and one line says why the command ends."""
    assert ends(capsys, lambda: time.sleep(600.0)) == "clearcap: interrupted\n"


def test_second_interrupt_while_the_first_is_reported(capsys, monkeypatch):
    """An exception in the hook for swallowed ones would be lost, and a traceback printed: it is raised after it."""
    sent = []

    def interrupted(number):
        sent.append(number)
        if len(sent) == 1:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(interrupts, "send_again", interrupted)
    hook = sys.unraisablehook
    assert ends(capsys, lambda: signal.raise_signal(sent[-1])) == "clearcap: interrupted\n"
    assert sent == [signal.SIGINT, signal.SIGINT]
    assert sys.unraisablehook is hook
