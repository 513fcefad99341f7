"""Run a campaign from Python until it is complete."""

from pathlib import Path
from typing import TYPE_CHECKING

from campaign.cluster.cluster import Cluster
from campaign.coordinator.submit import plan_campaign
from campaign.errors import SpecError
from campaign.spec.load import Campaign, Source
from campaign.store.layout import CANCEL
from clearcap.command_process import Progress, compute
from clearcap.results import Results

if TYPE_CHECKING:
    from distributed import Client


def run_campaign(
    campaign: Source | Campaign,
    *,
    samples: int | None = None,
    seed: int | None = None,
    store: str | Path = "runs",
    workers: int | None = None,
    cluster: "Cluster | Client | None" = None,
    progress: Progress = True,
    decide: bool = True,
) -> Results:
    """Run a campaign until it is complete and return its results.

    A second call continues where an earlier one stopped, and computes nothing if the campaign is complete. The campaign
    runs in a separate process, as with ``clearcap run``, so a script needs no ``__main__`` guard.

    Parameters
    ----------
    campaign : str, Path, mapping or Campaign
        Name of a shipped campaign, path of a campaign file, its tables as a dict, whose ``mechanism`` may be a
        `Mechanism`, or the return value of `load_campaign`.
    samples, seed : int, optional
        Number of samples and seed, instead of the campaign's own.
    store : str or Path
        Folder or URL of the store.
    workers : int, optional
        Number of worker processes on this machine; by default one per core.
    cluster : Cluster or distributed.Client, optional
        Where to compute instead of on this machine: it has workers of its own.
    progress : bool or callable
        Write a line to `sys.stderr` every ten seconds; or a function, called here with each `Heartbeat`, every two
        seconds. What it raises ends the run.
    decide : bool
        Compute further runs for verdicts that the samples leave open, as many as the campaign's ``decide`` allows.

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
    where = Cluster.of(cluster, workers)
    opened, plan = plan_campaign(campaign, str(store), samples, seed)
    opened.remove(plan.campaign_id, CANCEL)
    compute(opened, plan, "resume", [*where.options(), "--decide" if decide else "--no-decide"], progress)
    return Results(opened, plan)
