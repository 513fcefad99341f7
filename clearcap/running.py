"""Have a verb of the command compute a campaign, in a process of its own, and follow it from Python to its end."""

import signal
import subprocess
import sys
import warnings
from collections.abc import Callable
from threading import Thread
from typing import TextIO

from campaign.coordinator.heartbeat import Heartbeat, observe
from campaign.coordinator.lease import HEARTBEAT_INTERVAL
from campaign.errors import CampaignError, SpecError, UnreachableError
from campaign.plan_header import PlanHeader
from campaign.processes import STORE
from campaign.store import Store
from engine.platform.child import python_environment

INTERRUPTED = 130  # exit status of the command after Ctrl-C
ENDS_WITHIN = 60.0  # s, time for an interrupted coordinator to release its lease and its workers
_ERRORS: dict[int, type[CampaignError]] = {2: SpecError, 4: UnreachableError}
_PREFIX = "clearcap: "

Progress = bool | Callable[[Heartbeat], None]


def compute(store: Store, plan: PlanHeader, verb: str, options: list[str], progress: Progress) -> None:
    """Compute a planned campaign with a verb of the command; raises the errors of `clearcap.run_campaign`."""
    command = [sys.executable, "-P", "-m", "clearcap", verb, plan.campaign_id, "--no-report", "--json"]
    environment = {**python_environment(), STORE: store.files.full_url}  # unlike arguments, hidden from other users
    nothing, pipe = subprocess.DEVNULL, subprocess.PIPE
    process = subprocess.Popen(
        [*command, *options], stdin=nothing, stdout=nothing, stderr=pipe, env=environment, text=True, errors="replace"
    )
    with process:
        try:
            if callable(progress):
                message = _observed(process, store, plan.campaign_id, progress)
            else:
                message = _follow(process, sys.stderr if progress else None)
        except BaseException:  # of a progress function, too
            # end cleanly: a Ctrl-C in a terminal reached the process too, a notebook's interrupt did not
            process.send_signal(signal.SIGINT)
            try:
                process.wait(ENDS_WITHIN)
            except subprocess.TimeoutExpired:
                process.kill()
            raise
    if process.returncode == INTERRUPTED:
        raise KeyboardInterrupt
    if process.returncode == 1 and not store.survey(plan).missing:
        warnings.warn(message, stacklevel=3)
    elif process.returncode:
        raise _ERRORS.get(process.returncode, CampaignError)(message)


def _observed(process: "subprocess.Popen[str]", store: Store, campaign: str, show: Callable[[Heartbeat], None]) -> str:
    """Call a function with each heartbeat, in this thread, until the process ends; return its last message."""
    said: list[str] = []
    reader = Thread(target=lambda: said.append(_follow(process, None)), daemon=True)
    reader.start()
    before: Heartbeat | None = None
    has_ended = False
    while not has_ended:
        reader.join(HEARTBEAT_INTERVAL / 2)
        has_ended = not reader.is_alive()
        beat = observe(store, campaign).heartbeat
        if beat is not None and beat != before:
            show(beat)
        before = beat
    return said[0]


def _follow(process: "subprocess.Popen[str]", progress: TextIO | None) -> str:
    """Forward the output of the process until it ends; return its last message, or everything after its last error."""
    message = ""
    for line in process.stderr or ():
        if progress is not None:
            progress.write(line)
            progress.flush()
        is_new = line.startswith(_PREFIX) or not line.startswith(" ")
        message = line.removeprefix(_PREFIX) if is_new else message + line
    process.wait()
    return message.removeprefix("error: ").strip() or f"the coordinator ended with status {process.returncode}"
