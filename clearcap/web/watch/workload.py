"""The workload of a store: the process that serves it, and the running and waiting campaigns with their workers."""

import time
from collections.abc import Iterable
from dataclasses import dataclass

from campaign.coordinator.heartbeat import Observation, observe
from campaign.coordinator.lease import HEARTBEAT_INTERVAL, SignOfLife, holder, judge_life
from campaign.store import Store
from campaign.store.layout import HEARTBEAT, LEASE, SERVICE
from clearcap.web.watch.entry import CampaignEntry

UNSETTLED = ("queued", "running", "interrupted")  # states from which a campaign may continue


@dataclass(frozen=True)
class ServingProcess:
    """The process that coordinates the queued campaigns of a store."""

    pid: str
    machine: str
    seconds: float | None  # time that it has served, by its heartbeats; None before the first
    sign: SignOfLife  # whether the process is alive


@dataclass(frozen=True)
class UnsettledCampaign:
    """A campaign that runs or waits for a coordinator."""

    entry: CampaignEntry  # in the list of campaigns
    seen: Observation  # current state by its own files
    pid: str  # of the process on `machine` that coordinates it; both empty if there is none
    machine: str


@dataclass(frozen=True)
class Workload:
    """The running and waiting campaigns of a store, and the process that serves it."""

    serving: ServingProcess | None  # None if there is none, or it has shut down properly
    running: list[UnsettledCampaign]
    waiting: list[UnsettledCampaign]  # in the order in which the serving process takes them

    @property
    def workers(self) -> int:
        """Number of workers of all running campaigns."""
        return sum(each.seen.heartbeat.workers for each in self.running if each.seen.heartbeat)


def look_at_work(store: Store, entries: Iterable[CampaignEntry], earlier: Workload | None = None) -> Workload:
    """Return the current workload of a store that does not wait (`Store.hasty`); the files are read once.

    `earlier` is the result of the previous look: two are needed to tell whether a process on another machine is alive.
    """
    before = {} if earlier is None else {each.entry.campaign: each.seen for each in earlier.running}
    found = []
    for entry in sorted(entries, key=lambda each: each.campaign):
        if entry.state in UNSETTLED:
            seen, lease = observe(store, entry.campaign, before.get(entry.campaign)), None
            if seen.state == "running":
                lease = store.read_json(entry.campaign, LEASE)
            found.append(UnsettledCampaign(entry, seen, *holder(lease)))
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
    return ServingProcess(*holder(lease), seconds, sign)
