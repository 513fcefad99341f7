"""``clearcap`` whose runs are those of the stand-in: ``python -m tests.campaign.storms.command VERB ...``.

The environment says how long a run takes, and names the file that says how wrong the clock is.
"""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

SECONDS = "CLEARCAP_STORM_SECONDS"  # that a run takes
CLOCK = "CLEARCAP_STORM_CLOCK"  # path of a file that holds how many seconds the clock is ahead


def wrong_clock(file, right=time.time):
    """Return a clock that may jump at any moment."""

    def wrong():
        return right() + float(file.read_text() or 0.0)

    return wrong


def _start(words, **how):
    """Start another ``clearcap`` as this one is."""
    return subprocess.Popen([__spec__.name if word == "clearcap" else word for word in words], **how)


def main():
    """Put the stand-in in the engine's place and the wrong clock in the right one's, and run the command."""
    time.time = wrong_clock(Path(os.environ[CLOCK]))  # first of all: dask keeps the function that it finds
    handler = signal.signal(signal.SIGINT, signal.SIG_DFL)  # while this imports, not yet under the command's care
    from campaign.coordinator import coordinate, submit
    from clearcap import cli
    from tests.campaign import fake_engine

    start_alike = SimpleNamespace(**{**vars(subprocess), "Popen": _start})
    submit.subprocess = start_alike
    if "serve" in sys.argv:
        from clearcap.web import web_service

        web_service.subprocess = start_alike
    simulate = partial(fake_engine.takes, float(os.environ[SECONDS]))
    coordinate.coordinate = partial(coordinate.coordinate, simulate=simulate)
    submit.submit = partial(submit.submit, simulate=simulate)
    signal.signal(signal.SIGINT, handler)
    cli.main()


if __name__ == "__main__":
    main()
