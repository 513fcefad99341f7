"""A bounded window of batches in flight on a cluster: handed out, taken back, and watched meanwhile."""

import logging
import os
import time
from queue import Empty, SimpleQueue
from typing import Any

from distributed import Client

from campaign.coordinator.lease import HEARTBEAT_INTERVAL, LeaseLost, lease_holder
from campaign.coordinator.results import Drive, Handed, Lost, settle
from campaign.coordinator.stopping_rule import judge
from campaign.coordinator.work_queue import WorkQueue
from campaign.errors import CampaignError
from campaign.store.layout import CANCEL, HEARTBEAT, STOPPED
from campaign.worker.batch import run_batches
from campaign.worker.messages import BatchRequest, Cancelled

logger = logging.getLogger(__name__)

BATCHES_PER_WORKER = 3  # in flight: one runs, one waits at the worker, one at the scheduler
RECORD_EVERY = 30.0  # s, the manifest: it only saves time
TASK_TAKES, LARGEST_TASK = 0.5, 20  # s, batches: shorter ones go together, for dask takes milliseconds a task
SOUND_WITHIN = 8.0  # s: a worker of the right build that was killed is back by then
MISSED_AFTER = 60.0  # s without a worker, until it is said


def compute(drive: Drive, client: Client) -> None:
    """Keep a window of batches in flight until none is left to hand out and all have arrived, or it stops when sure.

    Raises
    ------
    Lost
        If the scheduler is gone.
    LeaseLost, Cancelled, TooManyFailed, StoreError, CampaignError
        What ends the campaign; see `campaign.coordinator.coordinator.coordinate`.
    """
    finished: SimpleQueue[Handed] = SimpleQueue()
    in_flight: dict[str, tuple[list[BatchRequest], Handed]] = {}
    next_beat = time.monotonic()
    try:
        while True:
            _refill(drive, client, in_flight, finished)
            if not in_flight:
                return
            if time.monotonic() >= next_beat:
                _watch(drive, client)
                next_beat = time.monotonic() + HEARTBEAT_INTERVAL
            try:
                future = finished.get(timeout=max(next_beat - time.monotonic(), 0.0))
            except Empty:
                continue
            orders, _ = in_flight.pop(str(future.key))
            settle(drive, orders, future)
            future.release()
            if look_for_checkpoint(drive):
                return
    finally:
        if in_flight and client.status == "running":
            client.cancel([future for _, future in in_flight.values()], force=True)


def _refill(drive: Drive, client: Client, in_flight: dict[str, Any], finished: "SimpleQueue[Handed]") -> None:
    """Submit batches until the window is full."""
    window = BATCHES_PER_WORKER * max(drive.workers, 1)
    _reach_ahead(drive, window)
    while len(in_flight) < window and (orders := _next(drive)):
        drive.submitted += 1
        trusted = _trusted(drive, client)
        future = client.submit(
            run_batches,
            drive.task,
            orders,
            key=f"batch-{orders[0].batch:06d}-{drive.token}-{drive.submitted}",
            pure=False,
            workers=trusted,
            allow_other_workers=trusted is not None,  # one that ends is back under another address
        )
        in_flight[str(future.key)] = orders, future
        future.add_done_callback(finished.put)


def _next(drive: Drive) -> list[BatchRequest]:
    """Return what to hand out next: a batch, or several that are short as yet; not so many that others would wait."""
    share = len(drive.queue) // (BATCHES_PER_WORKER * max(drive.workers, 1))
    fitting = 1 if drive.seconds is None else int(TASK_TAKES / max(drive.seconds, 1e-3))
    orders: list[BatchRequest] = []
    while len(orders) < max(min(fitting, share, LARGEST_TASK), 1) and (order := drive.queue.next()) is not None:
        orders.append(order)
    return orders


def _trusted(drive: Drive, client: Client) -> list[str] | None:
    """Return the workers that may compute, waiting a while for one if there is none; None for all."""
    if not drive.refused:
        return None
    until = time.monotonic() + SOUND_WITHIN
    while not (known := set(client.scheduler_info(n_workers=-1)["workers"]) - drive.refused):
        if client.status != "running":
            raise Lost(f"client {client.status}")
        if time.monotonic() > until:
            raise CampaignError(
                f"no worker left with engine build {drive.plan.engine_build}, which campaign {drive.plan.campaign_id}"
                " is planned for; install that version on the workers, or run the campaign anew"
            )
        time.sleep(HEARTBEAT_INTERVAL / 4)
    return sorted(known)


def _reach_ahead(drive: Drive, window: int) -> None:
    """With a stopping rule, compute no further than one window beyond the next checkpoint."""
    if drive.checkpoints:
        drive.queue.limit = drive.queue.batches_for(drive.checkpoints[0]) + window


def look_for_checkpoint(drive: Drive) -> bool:
    """Ask the stopping rule at each checkpoint that is complete; return whether the campaign ends there."""
    while drive.checkpoints and drive.queue.completed(drive.checkpoints[0]):
        drive.verdict = judge(drive.store, drive.plan, drive.checkpoints.pop(0))
        logger.info("%s", drive.verdict.text())
        if drive.verdict.sure:
            drive.store.write_json(drive.plan.campaign_id, STOPPED, drive.verdict.to_json())
            drive.queue = WorkQueue(drive.plan, drive.parts, drive.verdict.samples)
            drive.ledger.recount(drive.store, drive.store.survey(drive.plan))
            drive.checkpoints = []
            return True
    return False


def _watch(drive: Drive, client: Client) -> None:
    """Every two seconds: is the scheduler there, is the lease ours, is it cancelled? And say how far it is."""
    if client.status != "running":
        raise Lost(f"client {client.status}")
    drive.workers = len(client.scheduler_info(n_workers=-1)["workers"])
    _miss_workers(drive, client)
    campaign_id = drive.plan.campaign_id
    if drive.store.files.exists(f"{campaign_id}/{CANCEL}"):
        raise Cancelled(f"campaign {campaign_id} is cancelled; clearcap resume {campaign_id} goes on")
    if lease_holder(drive.store, campaign_id) not in (drive.token, None):
        raise LeaseLost(f"campaign {campaign_id} was taken over by another process")
    if time.monotonic() - drive.recorded > RECORD_EVERY:
        drive.store.record(drive.plan, drive.parts.values())
        drive.recorded = time.monotonic()
    beat(drive, "running")


def _miss_workers(drive: Drive, client: Client) -> None:
    """Say now and then that nobody computes."""
    now = time.monotonic()
    drive.alone_since = None if drive.workers else (drive.alone_since or now)
    if drive.alone_since is not None and now - drive.alone_since > MISSED_AFTER:
        address = client.scheduler_info(n_workers=0)["address"]
        logger.warning("scheduler %s has no workers; waiting for some to join it", address)
        drive.alone_since = now


def beat(drive: Drive, state: str) -> None:
    """Say how far the campaign is."""
    drive.beats += 1
    said = drive.ledger.heartbeat(state, drive.workers, token=drive.token, beat=drive.beats, pid=os.getpid())
    drive.store.write_json(drive.plan.campaign_id, HEARTBEAT, said.to_json())
    drive.show(said)
