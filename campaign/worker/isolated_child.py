"""The child process that computes runs in isolation; `campaign.worker.subprocess_runs` starts it.

It reads the request from its standard input. To its original standard output it writes one pickle per event, so that
the parent process always knows whether a run is in progress:

- ``("begun", sample)`` before a run begins,
- ``("row", row)`` after the run has ended,
- ``("doubtful", row)`` if the run raised an error that the machine may have caused; nothing follows,
- ``("failed", error)`` if the process cannot go on for reasons of its own; nothing follows.

This module imports only the standard library, so that an error while importing the project is sent like any other.
"""

import os
import pickle
import signal
import sys
import traceback
from typing import Any, BinaryIO

COMMAND = (sys.executable, "-P", "-c", "from campaign.worker.isolated_child import main; main()")


def main() -> None:
    """Compute the rows requested on standard input, then end the process."""
    for from_a_terminal in (signal.SIGINT, signal.SIGHUP):  # meant for the process that talks to the user
        signal.signal(from_a_terminal, signal.SIG_IGN)
    request, answers = _take_pipes()
    try:
        _compute(request, answers)
    except (EOFError, BrokenPipeError):  # the process that started this one has ended
        os._exit(1)
    except Exception as error:
        traceback.print_exc()
        _send(answers, "failed", _portable(error))
    os._exit(0)  # without waiting for threads


def _compute(request: BinaryIO, answers: BinaryIO) -> None:
    """Compute the requested rows and send them."""
    from campaign.worker.limits import end_with
    from campaign.worker.messages import DoubtfulRun
    from campaign.worker.row import rows_in_process

    address, samples, attempt = pickle.load(request)
    end_with(request)
    try:
        for row in rows_in_process(address, samples, attempt, lambda sample: _send(answers, "begun", sample)):
            _send(answers, "row", row)
    except DoubtfulRun as error:
        _send(answers, "doubtful", error.row)


def _take_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Return the pipes from and to the parent; runs get an empty standard input, and print to standard error."""
    request, answers = os.fdopen(os.dup(0), "rb", buffering=0), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return request, answers


def _send(answers: BinaryIO, kind: str, content: Any) -> None:
    """Send one message."""
    pickle.dump((kind, content), answers)
    answers.flush()


def _portable(error: Exception) -> Exception:
    """Return an error that can be pickled: the error itself, or a `ChildFailed` with its text."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickling an error of any class can fail in any way
        from campaign.worker.messages import ChildFailed

        return ChildFailed(f"{type(error).__name__}: {error}")
    return error
