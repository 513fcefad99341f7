"""Compute rows in an isolated subprocess, for a batch that killed its worker: the run at fault becomes a row.

The child (``python -m campaign.worker.subprocess_runs``) reads from its standard input what to compute and writes one
pickle for each row. It ends when its standard input is closed, so no child outlives its worker.
"""

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import BinaryIO

from campaign.worker.limits import end_with_stdin
from campaign.worker.messages import CampaignAddress, Cancelled
from campaign.worker.row import Row, crashed_row, sample_values
from campaign.worker.runs import open_campaign, rows_in_process

# Signals that operators and the operating system send too, so that they do not prove the run guilty.
AMBIGUOUS = {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
TRIES = 3  # attempts at a run whose process such a signal ends


def rows_in_subprocess(address: CampaignAddress, samples: Sequence[int], attempt: int) -> Iterator[Row]:
    """Yield the row of each sample, computed in a child process; a child that dies is replaced by another.

    The run at which a child died becomes a row too. If the signal that ended the child may have come from outside, the
    run is first repeated alone, and counts as guilty if it ends `TRIES` children in a row.

    Parameters
    ----------
    address : CampaignAddress
        The campaign.
    samples : sequence of int
        Numbers of the samples.
    attempt : int
        Attempt number of the batch, from 1.

    Yields
    ------
    Row
        One for each sample, in the order of ``samples``.

    Raises
    ------
    Cancelled
        If the campaign is cancelled meanwhile.
    """
    _, plan = open_campaign(address)
    deaths = 0  # children in a row that the first of the remaining samples ended
    while samples:
        requested, received = samples[:1] if deaths else samples, 0
        with _child(address, requested, attempt + deaths) as child:
            for row in _answers(child):
                if isinstance(row, Cancelled):
                    raise row
                yield row
                received += 1
            exit_status = child.wait()
        samples = samples[received:]
        if received == len(requested):
            deaths = 0
            continue
        deaths += 1
        if -exit_status in AMBIGUOUS and deaths < TRIES:
            continue
        status, message = _cause(exit_status)
        values, attempts = sample_values(plan, samples[0]), attempt + deaths - 1
        yield crashed_row(plan, samples[0], values, message, status=status, attempts=attempts)
        samples, deaths = samples[1:], 0


def _child(address: CampaignAddress, samples: Sequence[int], attempt: int) -> "subprocess.Popen[bytes]":
    """Start a child for the samples; it can import what this process can, and Ctrl-C does not reach it."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    child = subprocess.Popen(
        [sys.executable, "-m", "campaign.worker.subprocess_runs"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
        start_new_session=True,
    )
    assert child.stdin is not None
    pickle.dump((address, samples, attempt), child.stdin)
    child.stdin.flush()
    return child


def _answers(child: "subprocess.Popen[bytes]") -> Iterator[Row | Cancelled]:
    """Yield the answers of a child until it ends; an incomplete one is dropped."""
    assert child.stdout is not None
    try:
        while True:
            yield pickle.load(child.stdout)
    except (EOFError, pickle.UnpicklingError):
        return


def _cause(exit_status: int) -> tuple[str, str]:
    """Return status and message of the row of a run that ended its process with this exit status."""
    repeat = "repeat it with clearcap replay to see why"
    if exit_status == -signal.SIGALRM:
        return "timeout", f"the run took no notice of its time limit and was ended; {repeat}"
    if exit_status < 0:
        return "crashed", f"the run killed its process ({signal.Signals(-exit_status).name}); {repeat}"
    return "crashed", f"the run ended its process (exit status {exit_status}); {repeat}"


def main() -> None:
    """Read from standard input what to compute, and write the rows."""
    answers = _answer_pipe()
    address, samples, attempt = pickle.load(sys.stdin.buffer)
    end_with_stdin()
    try:
        for row in rows_in_process(address, samples, attempt):
            pickle.dump(row, answers)
            answers.flush()
    except Cancelled as error:
        pickle.dump(error, answers)
        answers.flush()
    os._exit(0)  # without waiting for the thread that reads standard input


def _answer_pipe() -> BinaryIO:
    """Return the pipe to the parent, and send to standard error what runs print."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return answers


if __name__ == "__main__":
    main()
