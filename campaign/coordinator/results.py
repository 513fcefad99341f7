"""What becomes of batches that were handed out to workers: rows, or another try."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from distributed import Future, KilledWorker

from campaign.coordinator.heartbeat import Heartbeat, Progress
from campaign.coordinator.stopping_rule import Verdict
from campaign.coordinator.work_queue import WorkQueue
from campaign.errors import CampaignError, StoreError
from campaign.plan import Plan
from campaign.store import Store
from campaign.worker.messages import BatchRequest, BatchResult, CampaignAddress, Cancelled, WrongBuild

logger = logging.getLogger(__name__)

ANSWERS_WITHIN = 30.0  # s, what a finished batch reports
TRIES = 10  # at a batch, and at the store, in a row
PAUSES = (0.5, 15.0)  # s, the first and the longest, each twice as long as the one before

Show = Callable[[Heartbeat], None]
Handed = Future[list[BatchResult]]


class Lost(Exception):
    """The scheduler is gone, and with it all that it was told."""


class TooManyFailed(CampaignError):
    """More runs failed than the campaign allows."""


@dataclass
class Drive:
    """What the coordinator knows while it drives a campaign."""

    store: Store
    plan: Plan
    task: CampaignAddress
    ledger: Progress
    parts: dict[int, Any]
    queue: WorkQueue
    token: str
    show: Show
    verdict: Verdict | None = None
    checkpoints: list[int] = field(default_factory=list)
    refused: set[str] = field(default_factory=set)
    seconds: float | None = None
    troubles: int = 0
    beats: int = 0
    submitted: int = 0
    workers: int = 0
    alone_since: float | None = None
    recorded: float = 0.0


def settle(drive: Drive, orders: list[BatchRequest], future: Handed) -> None:
    """Take note of what became of batches that were handed out together."""
    if future.status == "cancelled":
        raise Lost("connection closed")
    try:
        done = future.result(timeout=ANSWERS_WITHIN)
    except TimeoutError as error:
        raise Lost("a finished batch does not answer") from error
    except KilledWorker:
        logger.warning("%s took its worker with it: its runs get a process of their own", _named(orders))
        _put_back(drive, [_apart(order) for order in orders])
    except WrongBuild as error:
        drive.refused.add(error.worker)
        logger.warning("worker %s: %s; it gets no more batches", error.worker, error)
        _put_back(drive, orders)
    except Cancelled:
        _put_back(drive, orders)  # the next look at the marker ends the campaign
    except (StoreError, OSError) as error:
        _trouble(drive, orders, error)
    except Exception as error:
        raise CampaignError(f"{_named(orders)} cannot be computed: {type(error).__name__}: {error}") from error
    else:
        drive.troubles = 0
        for each in done:
            drive.parts[each.part.batch] = each.part
            drive.ledger.add(each)
            drive.queue.complete(each.part.batch)
        drive.seconds = max((each.seconds for each in done if each.computed), default=drive.seconds)
        _enough_good(drive)


def _named(orders: list[BatchRequest]) -> str:
    first, last = orders[0].batch, orders[-1].batch
    return f"batch {first}" if first == last else f"one of batches {first} to {last}"


def _put_back(drive: Drive, orders: list[BatchRequest]) -> None:
    for order in reversed(orders):
        drive.queue.requeue(order)


def _apart(order: BatchRequest) -> BatchRequest:
    if order.attempt >= TRIES:
        raise CampaignError(
            f"batch {order.batch} was given to {TRIES} workers and all of them ended, although its runs had a process"
            " of their own; look at the workers' logs and their memory, then resume"
        )
    return BatchRequest(order.batch, order.attempt + 1, isolated=True)


def _trouble(drive: Drive, orders: list[BatchRequest], error: Exception) -> None:
    """Try again what the store refused, ever more rarely, then give up with what it said."""
    drive.troubles += 1
    _put_back(drive, orders)
    if drive.troubles >= TRIES:
        raise error if isinstance(error, StoreError) else StoreError(f"{_named(orders)}: {error}") from error
    if drive.troubles == 1:
        logger.warning("%s; trying again", error)
    time.sleep(pause(drive.troubles))


def _enough_good(drive: Drive) -> None:
    """End a campaign of which too many runs fail."""
    most = drive.plan.spec.failures.most_failed(drive.plan.spec.samples)
    if drive.ledger.failed > most:
        raise TooManyFailed(
            f"{drive.ledger.failed} of {drive.ledger.done} runs failed, and failures.max_failed allows {most:g};"
            " look at their messages with clearcap status, mend the cause, or raise the limit"
        )


def pause(time_number: int) -> float:
    """Return how long to wait [s] before a thing is tried anew, having failed so often in a row."""
    first, longest = PAUSES
    return min(first * 2.0 ** min(time_number - 1, 20), longest)
