"""Write the plan of a campaign into a store, and assign a coordinator to it."""

import getpass
import logging
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from campaign.coordinator.delete import finish_deletion
from campaign.coordinator.lease import is_alive, is_coordinated
from campaign.coordinator.reuse import reuse_rows
from campaign.coordinator.run_time import known_seconds_per_run, seconds_per_run
from campaign.coordinator.state import state_of, write_state
from campaign.environment import STORE
from campaign.errors import unwritable
from campaign.plan import Plan, batch_size_is_fixed, make_plan
from campaign.safe_path import python_environment
from campaign.spec.load import Campaign
from campaign.store import Store
from campaign.store.label_versions import claim
from campaign.store.labels import LabelChange, is_owner
from campaign.store.layout import CANCEL, LEASE, LOG, SERVICE, SUBMISSION
from campaign.worker.messages import Simulate
from engine import simulate

logger = logging.getLogger(__name__)


def submit(
    store: Store,
    campaign: Campaign,
    batch_size: int | None = None,
    simulate: Simulate = simulate,
    *,
    labels: LabelChange | None = None,
    tries_runs: bool = True,
    by: str | None = None,
) -> Plan:
    """Write the plan of a campaign into a store, or return the plan that the store already has.

    Parameters
    ----------
    store : Store
        The store to write the plan to.
    campaign : Campaign
        The campaign.
    batch_size : int, optional
        Number of samples in a batch of a new plan; by default, so many that a batch takes about ten seconds. An
        existing plan keeps its batches.
    simulate : callable
        `engine.simulate`, or a function with the same parameters to use instead.
    labels : LabelChange, optional
        Owner and tags. By default a new campaign's owner is the user of this process. Identical campaigns of two people
        are one campaign: its first owner stays, and a message says so; tags are added.
    tries_runs : bool
        Whether to estimate the time of a run from a few runs in a separate process, which may take minutes. If False,
        nothing is simulated: the time is taken from runs of this mechanism in the store; without any, batches are
        small.
    by : str, optional
        Who submits it; by default the user of this process.

    Returns
    -------
    Plan
        The plan in the store.
    """
    new, user = make_plan(campaign, batch_size), user_name() if by is None else by
    is_new = new.campaign_id not in store.campaigns()
    if not is_new:
        plan = store.plan(new.campaign_id)
    else:
        finish_deletion(store, new.campaign_id)
        seconds = None
        if batch_size is None and not batch_size_is_fixed(campaign.spec.samples):
            seconds = seconds_per_run(new, simulate) if tries_runs else known_seconds_per_run(store, new)
        plan = store.create_plan(make_plan(campaign, batch_size, seconds))
        store.create_json(plan.campaign_id, SUBMISSION, {"user": user, "time": time.time()})
    _label(store, plan, labels or LabelChange(), user, is_new=is_new)
    if is_new:
        if reused := reuse_rows(store, plan):
            logger.info(
                "%d rows are reused from a campaign that differs only in its number of samples or its limits", reused
            )
        write_state(store, plan.campaign_id, "queued")
    if batch_size is not None and plan.batches != new.batches:
        logger.warning("the campaign is planned already: its batches of %d samples are kept", plan.batches[0][1])
    return plan


def _label(store: Store, plan: Plan, wanted: LabelChange, user: str, *, is_new: bool) -> None:
    """Give a campaign the owner and the tags that it is submitted with; log if it already has another owner."""
    if wanted.owner is None and is_new and is_owner(user):
        wanted = replace(wanted, owner=user)
    labels = claim(store, plan.campaign_id, wanted, user)
    submitter = user if wanted.owner is None else wanted.owner
    if labels.owner and labels.owner != submitter:
        logger.info("campaign %s was submitted before: its owner is and stays %s", plan.campaign_id, labels.owner)


def user_name() -> str:
    """Return the name of this process's user; empty if the system has no name for the user, as in some containers."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return ""


@dataclass(frozen=True)
class Assignment:
    """The coordinator that computes a campaign.

    Attributes
    ----------
    kind : str
        ``service`` (a coordinator that serves the store), ``coordinator`` (one for this campaign alone), or ``none``
        (the campaign waits for a service).
    pid : int or None
        Process id of a coordinator that was started for it.
    log : str or None
        Path of that coordinator's log.
    """

    kind: str
    pid: int | None = None
    log: str | None = None

    def text(self, store: Store) -> str:
        """Return the assignment in words."""
        if self.kind == "service":
            return "the coordinator that serves the store computes it"
        if self.kind == "none":
            return f"queued; compute the queued campaigns of the store with: {store.command('coordinate')}"
        if self.pid is None:
            return "a coordinator computes it already"
        return f"started a coordinator (process {self.pid}, log {self.log})"

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {"driver": self.kind, "pid": self.pid, "log": self.log}


def assign_coordinator(store: Store, plan: Plan, options: list[str], *, queue_only: bool = False) -> Assignment:
    """Assign a coordinator to a campaign, and start one if needed.

    Parameters
    ----------
    store : Store
        The store that holds the plan.
    plan : Plan
        The campaign.
    options : list of str
        Options of ``clearcap coordinate`` if it is started here, which say where to compute.
    queue_only : bool
        Whether to leave the campaign to a coordinator that serves the store, now or later.
    """
    store.remove(plan.campaign_id, CANCEL)
    if is_coordinated(store, plan.campaign_id):
        return Assignment("coordinator")
    if state_of(store, plan.campaign_id)["state"] != "completed" or store.survey(plan).missing:
        write_state(store, plan.campaign_id, "queued")
    if queue_only:
        return Assignment("none")
    if has_service(store):
        return Assignment("service")
    return Assignment("coordinator", *start_coordinator(store, plan, options))


def has_service(store: Store) -> bool:
    """Return whether a living coordinator serves the store."""
    lease = store.read_json(SERVICE, LEASE)
    return lease is not None and is_alive(store, SERVICE, lease)


def start_coordinator(store: Store, plan: Plan, options: list[str]) -> tuple[int, str]:
    """Start ``clearcap coordinate`` in a process that outlives this one.

    Parameters
    ----------
    store : Store
        The store that holds the plan.
    plan : Plan
        The campaign.
    options : list of str
        Options of the command, which say where to compute.

    Returns
    -------
    (int, str)
        Id of the process, and path of its log.
    """
    folder = Path(store.files.path(plan.campaign_id)) if store.files.local else Path.cwd()
    log = folder / (LOG if store.files.local else f"{plan.campaign_id}.log")
    words = [sys.executable, "-P", "-m", "campaign", "coordinate", plan.campaign_id, *options]
    try:
        file = log.open("ab")
    except OSError as error:
        message = f"log {log}: cannot be written ({error.strerror}); free the disk, or start in another folder"
        raise unwritable(message, error) from error
    with file:
        process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=file,
            cwd="/",
            env={**python_environment(), STORE: store.files.full_url},  # other users cannot read it there
            start_new_session=True,  # neither Ctrl-C nor the end of the terminal reaches it
        )
    return process.pid, str(log)
