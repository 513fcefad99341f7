"""Runs in a process of their own, for a batch that took its worker with it: the run that does so becomes a row.

The child (``python -m campaign.worker.subprocess_runs``) reads on its standard input what to compute and answers with
one pickle a row. It ends when its standard input is closed, so no child outlives its worker.
"""

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import BinaryIO

from campaign.worker.batch import Cancelled, Task, opened, rows_here
from campaign.worker.limits import end_with_stdin
from campaign.worker.row import Row, crashed_row, sample_values

FROM_OUTSIDE = {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}  # also sent by operators and kernels
TRIES = 3  # at a run whose process is ended by one of these


def rows_apart(task: Task, samples: Sequence[int], attempt: int) -> Iterator[Row]:
    """Compute rows of samples of a batch in another process; one that ends it becomes a row, and a new one is started.

    A signal that others send as well does not prove the run guilty: it is repeated alone, and is if that ends alike.

    Raises
    ------
    Cancelled
        If the campaign was cancelled meanwhile.
    """
    _, plan = opened(task)
    ended_at = 0  # how often in a row the first of the samples ended its process
    while samples:
        asked, answered = samples[:1] if ended_at else samples, 0
        with _child(task, asked, attempt + ended_at) as child:
            for row in _answers(child):
                if isinstance(row, Cancelled):
                    raise row
                yield row
                answered += 1
            ended = child.wait()
        samples = samples[answered:]
        if answered == len(asked):
            ended_at = 0
            continue
        ended_at += 1
        if -ended in FROM_OUTSIDE and ended_at < TRIES:
            continue
        status, message = _cause(ended)
        values, tries = sample_values(plan, samples[0]), attempt + ended_at - 1
        yield crashed_row(plan, samples[0], values, message, status=status, attempts=tries)
        samples, ended_at = samples[1:], 0


def _child(task: Task, samples: Sequence[int], attempt: int) -> "subprocess.Popen[bytes]":
    """Start a process for the samples; it imports what this one can, and Ctrl-C does not reach it."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    child = subprocess.Popen(
        [sys.executable, "-m", "campaign.worker.subprocess_runs"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
        start_new_session=True,
    )
    assert child.stdin is not None
    pickle.dump((task, samples, attempt), child.stdin)
    child.stdin.flush()
    return child


def _answers(child: "subprocess.Popen[bytes]") -> Iterator[Row | Cancelled]:
    """Yield what the child says until it ends; half an answer is none."""
    assert child.stdout is not None
    try:
        while True:
            yield pickle.load(child.stdout)
    except (EOFError, pickle.UnpicklingError):
        return


def _cause(ended: int) -> tuple[str, str]:
    """Return status and message of a run that ended its process with this exit status."""
    repeat = "repeat it with clearcap replay to see why"
    if ended == -signal.SIGALRM:
        return "timeout", f"the run took no notice of its time limit and was ended; {repeat}"
    if ended < 0:
        return "crashed", f"the run killed its process ({signal.Signals(-ended).name}); {repeat}"
    return "crashed", f"the run ended its process (exit status {ended}); {repeat}"


def main() -> None:
    """Compute what standard input says, and answer with rows."""
    answers = _only_answers()
    task, samples, attempt = pickle.load(sys.stdin.buffer)
    end_with_stdin()
    try:
        for row in rows_here(task, samples, attempt):
            pickle.dump(row, answers)
            answers.flush()
    except Cancelled as error:
        pickle.dump(error, answers)
        answers.flush()
    os._exit(0)  # without waiting for the thread that reads standard input


def _only_answers() -> BinaryIO:
    """Return the pipe to the parent, and let what runs print go to standard error."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return answers


if __name__ == "__main__":
    main()
