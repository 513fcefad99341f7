"""The process that computes runs in isolation, which `campaign.worker.subprocess_runs` starts.

It reads from its standard input what to compute. On what was its standard output it writes one pickle for each thing
that happens, so that the process that started it knows at any time whether a run was under way:

- ``("begun", sample)`` before a run begins,
- ``("row", row)`` when the run has ended,
- ``("doubtful", row)`` when the run raised an error that may be the machine's; nothing follows,
- ``("failed", error)`` when the process cannot go on for reasons of its own; nothing follows.

What this module imports is in the standard library: an error in an import of the project is sent like any other.
"""

import os
import pickle
import signal
import sys
import traceback
from typing import Any, BinaryIO

COMMAND = (sys.executable, "-P", "-c", "from campaign.worker.isolated_child import main; main()")


def main() -> None:
    """Compute what standard input asks for; end the process."""
    for from_a_terminal in (signal.SIGINT, signal.SIGHUP):  # they are for the process that talks to the user
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
    """Compute the rows that are requested and send them."""
    from campaign.worker.limits import end_with
    from campaign.worker.messages import DoubtfulRun
    from campaign.worker.runs import rows_in_process

    address, samples, attempt = pickle.load(request)
    end_with(request)
    try:
        for row in rows_in_process(address, samples, attempt, lambda sample: _send(answers, "begun", sample)):
            _send(answers, "row", row)
    except DoubtfulRun as error:
        _send(answers, "doubtful", error.row)


def _take_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Return the pipes from and to the parent; what runs read is empty, and what they print goes to standard error."""
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
    """Return an error that survives the pipe: itself, or a `ChildFailed` with its text."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # an error of any class can refuse in any way
        from campaign.worker.messages import ChildFailed

        return ChildFailed(f"{type(error).__name__}: {error}")
    return error
