"""Who drives a campaign: a lease in its folder, so that two coordinators do not double the work.

If they did, nothing would break: parts are written whole under their own names, and equal. A lease is stale when the
process that holds it is gone, if it ran on this machine, or when its heartbeat no longer changes. No clock of two
machines is ever compared.
"""

import os
import secrets
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from campaign.errors import CampaignError, StoreError
from campaign.store import Store
from campaign.store.layout import HEARTBEAT, LEASE

HEARTBEAT_INTERVAL = 2.0  # s, between two heartbeats
PATIENCE = 5 * HEARTBEAT_INTERVAL  # s without a new one, until its process counts as gone
SETTLE = 0.3  # s, for another one that takes the same stale lease to be seen


class LeaseHeld(CampaignError):
    """Another process drives the campaign."""


class LeaseLost(CampaignError):
    """Another process has taken the campaign over."""


@contextmanager
def hold_lease(store: Store, campaign_id: str) -> Iterator[str]:
    """Hold the lease of a campaign, and yield the token that says whose it is.

    Raises
    ------
    LeaseHeld
        If a process that is alive holds it.
    """
    token = take_lease(store, campaign_id)
    try:
        yield token
    finally:
        try:
            if lease_holder(store, campaign_id) == token:
                store.remove(campaign_id, LEASE)
        except StoreError:
            pass  # a lease that stays is stale when this process is gone


def take_lease(store: Store, campaign_id: str) -> str:
    """Take the lease of a campaign, a stale one too, and return its token."""
    mine = {"token": secrets.token_hex(8), **this_process()}
    if store.create_json(campaign_id, LEASE, mine):
        return str(mine["token"])
    other = store.read_json(campaign_id, LEASE)
    if other is not None and is_alive(store, campaign_id, other):
        raise LeaseHeld(
            f"campaign {campaign_id} is driven by process {other.get('pid')} on {other.get('name')};"
            " follow it with clearcap watch, or end it with clearcap cancel"
        )
    store.write_json(campaign_id, LEASE, mine)
    time.sleep(SETTLE)
    if lease_holder(store, campaign_id) != mine["token"]:
        raise LeaseHeld(f"campaign {campaign_id} was taken by another process at the same time; it drives it")
    return str(mine["token"])


def lease_holder(store: Store, campaign_id: str) -> str | None:
    """Return the token of who holds the lease, if anybody does."""
    lease = store.read_json(campaign_id, LEASE)
    return None if lease is None else str(lease.get("token"))


def is_alive(store: Store, folder: str, lease: dict[str, Any], heartbeat: str = HEARTBEAT) -> bool:
    """Return whether the process of a lease lives; looks at its heartbeat for a while if it is not on this machine."""
    here = this_process()
    if lease.get("host") == here["host"]:
        return _lives(lease)
    before, end = store.read_json(folder, heartbeat), time.monotonic() + PATIENCE
    while time.monotonic() < end:
        time.sleep(HEARTBEAT_INTERVAL / 2)
        if store.read_json(folder, heartbeat) != before:
            return True
    return False


def is_coordinated(store: Store, campaign_id: str) -> bool:
    """Return whether somebody holds the lease of a campaign who is not known to be gone; answers at once."""
    lease = store.read_json(campaign_id, LEASE)
    return lease is not None and (lease.get("host") != _host() or _lives(lease))


def _lives(lease: dict[str, Any]) -> bool:
    """Return whether the process of a lease of this machine is still that process."""
    return lease.get("started") is not None and lease.get("started") == _started(lease.get("pid"))


def this_process() -> dict[str, Any]:
    """Return what tells this process from every other on any machine."""
    return {"name": socket.gethostname(), "host": _host(), "pid": os.getpid(), "started": _started(os.getpid())}


def _host() -> str:
    """Return what is the same for two processes just when one sees the other's number."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot} {os.stat('/proc/self/ns/pid').st_ino}"
    except OSError:  # not Linux
        return socket.gethostname()


def _started(pid: Any) -> str | None:
    """Return when a process was started, in ticks since the machine was; None if it is gone or only a zombie."""
    try:
        fields = Path(f"/proc/{int(pid)}/stat").read_text().rpartition(")")[2].split()
        return None if fields[0] in "ZX" else fields[19]
    except FileNotFoundError:
        return _alive_elsewhere(pid) if not Path("/proc/self/stat").exists() else None
    except (OSError, ValueError, TypeError, IndexError):
        return None


def _alive_elsewhere(pid: Any) -> str | None:
    """Return a word for a living process where there is no /proc."""
    try:
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return None
    except PermissionError:
        return "alive"
    return "alive"
