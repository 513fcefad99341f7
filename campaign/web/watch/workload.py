"""What is computed now and what waits: who serves the store, and who coordinates each campaign on how many workers."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from campaign.coordinator.follow import Observation, observe
from campaign.coordinator.lease import HEARTBEAT_INTERVAL, SignOfLife, judge_life
from campaign.store import Store
from campaign.store.layout import HEARTBEAT, LEASE, SERVICE
from campaign.web.watch.entry import CampaignEntry

UNSETTLED = ("queued", "running", "interrupted")  # states of which a campaign may go on


@dataclass(frozen=True)
class ServingProcess:
    """The process that coordinates what is queued in a store.

    Attributes
    ----------
    pid, machine : str
        Which process it is.
    seconds : float or None
        For how long it has served, by its heartbeats [s]; None before the first.
    sign : SignOfLife
        Whether it lives.
    """

    pid: str
    machine: str
    seconds: float | None
    sign: SignOfLife


@dataclass(frozen=True)
class UnsettledCampaign:
    """A campaign that runs, or waits for a coordinator.

    Attributes
    ----------
    entry : CampaignEntry
        What the list says of it.
    seen : Observation
        What its own files say now.
    pid, machine : str
        Process that coordinates it; empty if none does.
    """

    entry: CampaignEntry
    seen: Observation
    pid: str
    machine: str


@dataclass(frozen=True)
class Workload:
    """What is computed now and what waits.

    Attributes
    ----------
    serving : ServingProcess or None
        None: no process serves the store, or has ended in order.
    running, waiting : list of UnsettledCampaign
        Those that wait, in the order in which the process that serves the store takes them.
    """

    serving: ServingProcess | None
    running: list[UnsettledCampaign]
    waiting: list[UnsettledCampaign]

    @property
    def workers(self) -> int:
        """Number of workers of all campaigns that run."""
        return sum(each.seen.heartbeat.workers for each in self.running if each.seen.heartbeat)


def look_at_work(store: Store, entries: Iterable[CampaignEntry], earlier: Workload | None = None) -> Workload:
    """Look at the store once; nothing waits.

    Parameters
    ----------
    store : Store
        One that does not wait: see `Store.hasty`.
    entries : iterable of CampaignEntry
        What the list says of all campaigns.
    earlier : Workload, optional
        What the look before returned: a process on another machine is judged by two looks.

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
    """Return the process that serves the store."""
    lease, heartbeat = store.read_json(SERVICE, LEASE), store.read_json(SERVICE, HEARTBEAT)
    if lease is None:
        return None
    sign = judge_life(lease, heartbeat, earlier.sign if earlier else None, time.monotonic())
    beats = (heartbeat or {}).get("beat")
    seconds = beats * HEARTBEAT_INTERVAL if isinstance(beats, int) else None
    return ServingProcess(*_holder(lease), seconds, sign)


def _holder(lease: dict[str, Any] | None) -> tuple[str, str]:
    """Return number and machine of the process that holds a lease, as texts of any content; empty without a lease."""
    return ("", "") if lease is None else (str(lease.get("pid", ""))[:20], str(lease.get("name", ""))[:200])
