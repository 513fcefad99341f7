"""The workload of a store: the process that serves it, and the running and waiting campaigns with their workers."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from campaign.coordinator.follow import Observation, observe
from campaign.coordinator.lease import HEARTBEAT_INTERVAL, SignOfLife, judge_life
from campaign.store import Store
from campaign.store.layout import HEARTBEAT, LEASE, SERVICE
from campaign.web.watch.entry import CampaignEntry

UNSETTLED = ("queued", "running", "interrupted")  # states from which a campaign may continue


@dataclass(frozen=True)
class ServingProcess:
    """The process that coordinates the queued campaigns of a store.

    Attributes
    ----------
    pid, machine : str
        Number of the process, and the machine it runs on.
    seconds : float or None
        Time that it has served, by its heartbeats [s]; None before the first heartbeat.
    sign : SignOfLife
        Whether the process is alive.
    """

    pid: str
    machine: str
    seconds: float | None
    sign: SignOfLife


@dataclass(frozen=True)
class UnsettledCampaign:
    """A campaign that runs or waits for a coordinator.

    Attributes
    ----------
    entry : CampaignEntry
        Its entry in the list of campaigns.
    seen : Observation
        Its current state by its own files.
    pid, machine : str
        The process that coordinates it; empty if there is none.
    """

    entry: CampaignEntry
    seen: Observation
    pid: str
    machine: str


@dataclass(frozen=True)
class Workload:
    """The running and waiting campaigns of a store, and the process that serves it.

    Attributes
    ----------
    serving : ServingProcess or None
        The process that serves the store; None if there is none, or it has shut down properly.
    running, waiting : list of UnsettledCampaign
        Campaigns; the waiting ones are in the order in which the serving process takes them.
    """

    serving: ServingProcess | None
    running: list[UnsettledCampaign]
    waiting: list[UnsettledCampaign]

    @property
    def workers(self) -> int:
        """Number of workers of all running campaigns."""
        return sum(each.seen.heartbeat.workers for each in self.running if each.seen.heartbeat)


def look_at_work(store: Store, entries: Iterable[CampaignEntry], earlier: Workload | None = None) -> Workload:
    """Return the current workload of a store; the files are read once, without waiting.

    Parameters
    ----------
    store : Store
        A store that does not wait; see `Store.hasty`.
    entries : iterable of CampaignEntry
        The list entries of all campaigns.
    earlier : Workload, optional
        Result of the previous look; two looks are needed to tell whether a process on another machine is alive.

    Raises
    ------
    StoreError
        If the store cannot be read.
    """
    before = {} if earlier is None else {each.entry.campaign: each.seen for each in earlier.running}
    found = []
    for entry in sorted(entries, key=lambda each: each.campaign):
        if entry.state in UNSETTLED:
            seen, lease = observe(store, entry.campaign, before.get(entry.campaign)), None
            if seen.state == "running":
                lease = store.read_json(entry.campaign, LEASE)
            found.append(UnsettledCampaign(entry, seen, *_holder(lease)))
    return Workload(
        serving=_serving(store, earlier.serving if earlier else None),
        running=[each for each in found if each.seen.state == "running"],
        waiting=[each for each in found if each.seen.state != "running" and each.seen.is_open],
    )


def _serving(store: Store, earlier: ServingProcess | None) -> ServingProcess | None:
    """Return the process that serves the store; None if no process holds its lease."""
    lease, heartbeat = store.read_json(SERVICE, LEASE), store.read_json(SERVICE, HEARTBEAT)
    if lease is None:
        return None
    sign = judge_life(lease, heartbeat, earlier.sign if earlier else None, time.monotonic())
    beats = (heartbeat or {}).get("beat")
    seconds = beats * HEARTBEAT_INTERVAL if isinstance(beats, int) else None
    return ServingProcess(*_holder(lease), seconds, sign)


def _holder(lease: dict[str, Any] | None) -> tuple[str, str]:
    """Return the number and machine of the process that holds a lease, as unchecked texts; empty without a lease."""
    return ("", "") if lease is None else (str(lease.get("pid", ""))[:20], str(lease.get("name", ""))[:200])
