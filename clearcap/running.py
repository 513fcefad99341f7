"""Run a campaign from Python until it is complete."""

import signal
import subprocess
import sys
import warnings
from pathlib import Path
from typing import TextIO

from campaign.cluster.cluster import Cluster
from campaign.coordinator.submit import plan_campaign
from campaign.environment import STORE
from campaign.errors import CampaignError, SpecError, UnreachableError
from campaign.plan import Plan
from campaign.spec.load import Campaign, Source
from campaign.store import Store
from campaign.store.layout import CANCEL
from clearcap.results import Results
from engine.platform.child import python_environment

INTERRUPTED = 130  # exit status of the command after Ctrl-C
ENDS_WITHIN = 60.0  # s, time for an interrupted coordinator to release its lease and its workers
_ERRORS: dict[int, type[CampaignError]] = {2: SpecError, 4: UnreachableError}
_PREFIX = "clearcap: "


def run_campaign(
    campaign: Source | Campaign,
    *,
    samples: int | None = None,
    seed: int | None = None,
    store: str | Path = "runs",
    workers: int | None = None,
    cluster: Cluster | None = None,
    progress: bool = True,
    decide: bool = True,
) -> Results:
    """Run a campaign until it is complete and return its results.

    A second call continues where an earlier one stopped, and computes nothing if the campaign is complete. The campaign
    runs in a separate process, as with ``clearcap run``, so a script needs no ``__main__`` guard.

    Parameters
    ----------
    campaign : str, Path, mapping or Campaign
        Name of a shipped campaign, path of a campaign file, the tables of such a file as a dict, or the return value of
        `load_campaign`.
    samples, seed : int, optional
        Number of samples and seed, instead of the campaign's own.
    store : str or Path
        Folder or URL of the store.
    workers : int, optional
        Number of worker processes on this machine; by default one per core.
    cluster : Cluster, optional
        Where to compute; by default on this machine. It has its own number of workers, so ``workers`` must not be
        given.
    progress : bool
        Write a progress line to `sys.stderr` every ten seconds.
    decide : bool
        Compute further runs for verdicts that the samples leave open, as many as the campaign's ``decide`` allows; the
        results then have one verdict from both.

    Returns
    -------
    Results
        One row per sample. A warning is issued if too few runs are ok, or none.

    Raises
    ------
    SpecError
        If the campaign, the address of the store or the cluster is wrong; nothing was computed.
    UnreachableError, StoreError
        If the cluster or the store keeps failing. Stored rows are kept, and the same call continues.
    CampaignError
        If the campaign cannot be completed, for instance because too many runs fail.
    KeyboardInterrupt
        On Ctrl-C. The same call continues the campaign.
    """
    if cluster is not None and workers is not None:
        raise SpecError(f"workers = {workers} and a cluster are given; name the workers in the cluster")
    if isinstance(campaign, Campaign) and (samples is not None or seed is not None):
        raise SpecError("samples and seed belong to load_campaign where the campaign is loaded already")
    opened, plan = plan_campaign(campaign, str(store), samples, seed)
    opened.remove(plan.campaign_id, CANCEL)
    options = [*(cluster or Cluster(workers=workers)).options(), "--decide" if decide else "--no-decide"]
    status, message = _resume(opened, plan, options, sys.stderr if progress else None)
    results = Results(opened, plan)
    if status == 1 and not opened.survey(plan).missing:
        warnings.warn(message, stacklevel=2)
    elif status:
        raise _ERRORS.get(status, CampaignError)(message)
    return results


def _resume(store: Store, plan: Plan, options: list[str], progress: TextIO | None) -> tuple[int, str]:
    """Compute a planned campaign in a separate process; return its exit status and its last message."""
    command = [sys.executable, "-P", "-m", "clearcap", "resume", plan.campaign_id, "--no-report", "--json"]
    environment = {**python_environment(), STORE: store.files.full_url}  # unlike arguments, hidden from other users
    process = subprocess.Popen(
        [*command, *options],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env=environment,
        text=True,
        errors="replace",
    )
    with process:
        try:
            message = _follow(process, progress)
        except KeyboardInterrupt:
            _interrupt(process)
            raise
    if process.returncode == INTERRUPTED:
        raise KeyboardInterrupt
    return process.returncode, message


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


def _interrupt(process: "subprocess.Popen[str]") -> None:
    """Make the process shut down cleanly: a Ctrl-C in a terminal reached it too, a notebook's interrupt did not."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(ENDS_WITHIN)
    except subprocess.TimeoutExpired:
        process.kill()
