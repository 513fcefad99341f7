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
from campaign.store.labels import LabelChange, claim, is_owner
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

    ``batch_size`` None makes a batch take about ten seconds, by the time of a few runs in a separate process (minutes),
    or, without ``tries_runs``, of stored runs of this mechanism; without any, batches are small. ``by`` None is the
    user of this process. The submitter owns a new campaign unless ``labels`` names an owner; one that the store has
    keeps its owner, with a message, and gets the tags.
    """
    new, user = make_plan(campaign, batch_size), user_name() if by is None else by
    is_new = new.campaign_id not in store.campaigns()
    if not is_new:
        plan = store.plan(new.campaign_id)
    else:
        # or its files, of an earlier campaign with this id, would be among those of the new one
        finish_deletion(store, new.campaign_id)
        seconds = None
        if batch_size is None and not batch_size_is_fixed(campaign.spec.samples):
            seconds = seconds_per_run(new, simulate) if tries_runs else known_seconds_per_run(store, new)
        plan = store.create_plan(make_plan(campaign, batch_size, seconds))
        store.create_json(plan.campaign_id, SUBMISSION, {"user": user, "time": time.time()})
    _label(store, plan, labels or LabelChange(), user, is_new=is_new)
    if is_new:
        # before the campaign is queued: from then on a service may compute the same rows
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
    """The coordinator that computes a campaign."""

    kind: str  # ``service`` (it serves the store), ``coordinator`` (of this campaign alone), or ``none`` (it waits)
    pid: int | None = None  # of a coordinator that was started for it
    log: str | None = None  # path of that coordinator's log

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
    """Assign a coordinator to a campaign, and start one if needed, with these options of ``clearcap coordinate``.

    ``queue_only`` leaves the campaign to a coordinator that serves the store, now or later.
    """
    store.remove(plan.campaign_id, CANCEL)  # of an earlier cancellation
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
    """Start ``clearcap coordinate`` in a process that outlives this one; return its id and the path of its log."""
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
