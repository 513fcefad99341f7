"""The lease of a campaign: a file in its folder that keeps two coordinators from doing the same work.

Even if they did, nothing would break: each part is written whole under a name of its own, and both would write the same
content. If the holder of a lease ran on this machine, the lease is stale once that process has ended; otherwise it is
stale once its heartbeat no longer changes. Clocks of two machines are never compared.
"""

import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

from campaign.errors import CampaignError, StoreError
from campaign.processes import meanwhile, process_space, started
from campaign.store import Store
from campaign.store.files.retry_policy import Outage
from campaign.store.layout import HEARTBEAT, LEASE, SERVICE

HEARTBEAT_INTERVAL = 2.0  # s between two heartbeats
STALE_AFTER = 5 * HEARTBEAT_INTERVAL  # s without a new heartbeat
RACE_WAIT = 0.3  # s after which another process that takes the same stale lease is visible


class LeaseHeld(CampaignError):
    """Another process coordinates the campaign."""


class LeaseLost(CampaignError):
    """Another process has taken the campaign over."""


@contextmanager
def hold_lease(store: Store, campaign_id: str) -> Iterator[str]:
    """Hold the lease of a campaign in the block, and yield its token; LeaseHeld if a process that is alive holds it."""
    token = secrets.token_hex(8)
    try:  # an interrupt may come as soon as the lease is written, before it is known to be
        take_lease(store, campaign_id, token=token)
        yield token
    except BaseException:
        _give_back(store.hasty, campaign_id, token)  # ending must not wait for an unreachable store
        raise
    _give_back(store, campaign_id, token)


def _give_back(store: Store, campaign_id: str, token: str) -> None:
    """Remove the lease if this process still holds it; if that fails, the lease becomes stale when the process ends."""
    with suppress(StoreError):
        if lease_holder(store, campaign_id) == token:
            store.remove(campaign_id, LEASE)


@contextmanager
def beating(store: Store, folder: str) -> Iterator[None]:
    """Write a heartbeat every two seconds during the block, for who holds a lease of a campaign or service."""
    hasty, outage = store.hasty, Outage(store.url, store.files.retry_policy)

    def write_heartbeats(over: threading.Event) -> None:
        count = 0
        while not over.is_set():
            count += 1
            try:
                hasty.write_json(folder, HEARTBEAT, {"beat": count, "time": time.time()})
                outage.end()
            except StoreError as error:
                outage.begin(error)
            over.wait(HEARTBEAT_INTERVAL)

    with meanwhile(write_heartbeats, f"heartbeats of {folder}"):
        yield


def take_lease(
    store: Store,
    campaign_id: str,
    clock: Callable[[], float] = time.monotonic,
    pause: Callable[[float], None] = time.sleep,
    token: str | None = None,
) -> str:
    """Take the lease of a campaign if it is free or stale, and return its token; raise `LeaseHeld` otherwise."""
    mine = {"token": token or secrets.token_hex(8), **this_process()}
    if store.create_json(campaign_id, LEASE, mine):
        return str(mine["token"])
    other = store.read_json(campaign_id, LEASE)
    if other is not None and is_alive(store, campaign_id, other, clock, pause):
        raise LeaseHeld(
            f"{_holding(store, campaign_id)} by process {other.get('pid')} on {other.get('name')};"
            f" {_remedy(store, campaign_id)}"
        )
    # of several processes that replace a stale lease the last one has it, so each must look again after the others
    store.write_json(campaign_id, LEASE, mine)
    pause(RACE_WAIT)
    if lease_holder(store, campaign_id) != mine["token"]:
        raise LeaseHeld(f"{_holding(store, campaign_id)} by another process, which began at the same time")
    return str(mine["token"])


def _holding(store: Store, folder: str) -> str:
    return f"store {store.url} is served" if folder == SERVICE else f"campaign {folder} is computed"


def _remedy(store: Store, folder: str) -> str:
    if folder == SERVICE:
        return "end that process first"
    return f"follow it with: {store.command('watch', folder)}; or end it with: {store.command('cancel', folder)}"


def lease_holder(store: Store, campaign_id: str) -> str | None:
    """Return the token of the lease; None if there is no lease."""
    lease = store.read_json(campaign_id, LEASE)
    return None if lease is None else str(lease.get("token"))


def check_lease(store: Store, campaign_id: str, token: str) -> None:
    """Raise `LeaseLost` if another process has taken the lease, for example after an outage of the store."""
    # without a lease nobody else coordinates the campaign
    if lease_holder(store, campaign_id) not in (token, None):
        raise LeaseLost(f"campaign {campaign_id} was taken over by another process")


def holder(lease: dict[str, Any] | None) -> tuple[str, str]:
    """Return the number and machine of the process that holds a lease, as unchecked texts; empty without a lease."""
    return ("", "") if lease is None else (str(lease.get("pid", ""))[:20], str(lease.get("name", ""))[:200])


@dataclass(frozen=True)
class SignOfLife:
    """The observed signs of life of the process that holds a lease; pass it to the next check."""

    token: str | None  # of the lease; None if there is no lease
    heartbeat: dict[str, Any] | None  # the last one, if it is needed to judge whether the process is alive
    seen_at: float  # when the lease or this heartbeat was first seen, by this process's clock [s]
    is_alive: bool | None  # None until there has been a new heartbeat or a long enough silence


def judge_life(
    lease: dict[str, Any] | None, heartbeat: dict[str, Any] | None, earlier: SignOfLife | None, now: float
) -> SignOfLife:
    """Judge from this check and the previous one, without waiting, whether the process that holds a lease is alive."""
    # Of a process on this machine that is known at once. One elsewhere is alive if its heartbeat has changed, and dead
    # if it has been the same for `STALE_AFTER` seconds. ``now`` is when both were read, by a monotonic clock [s].
    if lease is None:
        return SignOfLife(None, None, now, False)
    token = str(lease.get("token"))
    if lease.get("host") == process_space():
        return SignOfLife(token, None, now, _lives(lease))
    if earlier is None or earlier.token != token:
        return SignOfLife(token, heartbeat, now, None)
    if heartbeat != earlier.heartbeat:
        return SignOfLife(token, heartbeat, now, True)
    return replace(earlier, is_alive=False) if now - earlier.seen_at >= STALE_AFTER else earlier


def is_alive(
    store: Store,
    folder: str,
    lease: dict[str, Any],
    clock: Callable[[], float] = time.monotonic,
    pause: Callable[[float], None] = time.sleep,
) -> bool:
    """Return whether the holder of a lease is alive; on another machine, this takes up to `STALE_AFTER` seconds."""
    sign: SignOfLife | None = None
    while True:
        sign = judge_life(lease, store.read_json(folder, HEARTBEAT), sign, clock())
        if sign.is_alive is not None:
            return sign.is_alive
        pause(HEARTBEAT_INTERVAL / 2)


def is_coordinated(store: Store, campaign_id: str) -> bool:
    """Return at once whether the lease of a campaign is held by a process that is not known to have ended."""
    lease = store.read_json(campaign_id, LEASE)
    return lease is not None and (lease.get("host") != process_space() or _lives(lease))


def _lives(lease: dict[str, Any]) -> bool:
    """Return whether the holder of a lease on this machine is alive, and not another process with the same id."""
    return lease.get("started") is not None and lease.get("started") == started(lease.get("pid"))


def this_process() -> dict[str, Any]:
    """Return data that identify this process among those of all machines."""
    return {"name": socket.gethostname(), "host": process_space(), "pid": os.getpid(), "started": started(os.getpid())}
