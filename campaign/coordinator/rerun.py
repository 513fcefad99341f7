"""Compute rows again: of runs that crashed or timed out for a reason that is fixed by now."""

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from campaign.cluster.cluster import Cluster
from campaign.cluster.dask_workers import connect_workers
from campaign.coordinator.lease import hold_lease
from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.store import Store
from campaign.worker.messages import CampaignAddress, Simulate
from campaign.worker.row import Row, rows_to_table
from campaign.worker.runs import open_campaign
from campaign.worker.subprocess_runs import rows_in_subprocess
from engine import simulate

Counts = dict[str, int]


@dataclass(frozen=True)
class RerunResult:
    """Rows that were computed again.

    Attributes
    ----------
    samples : int
        Number of rows.
    before, after : dict of str to int
        Number of rows by status, before and after.
    """

    samples: int
    before: Counts
    after: Counts

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def failed_samples(store: Store, plan: Plan, statuses: Iterable[str] = ()) -> list[int]:
    """Return the samples whose run has one of ``statuses``, or by default any but ``ok``, in order."""
    selected, samples = set(statuses), []
    for table in store.stream(plan, ["sample", "status"]):
        rows = zip(table["sample"].to_pylist(), table["status"].to_pylist(), strict=True)
        samples += [sample for sample, status in rows if (status in selected if selected else status != "ok")]
    return samples


def rerun(
    store: Store, plan: Plan, samples: Iterable[int], cluster: Cluster, simulate: Simulate = simulate
) -> RerunResult:
    """Compute rows again, those of each batch in an isolated subprocess, and replace the batch's part.

    Parameters
    ----------
    store : Store
        Where the rows are.
    plan : Plan
        The campaign.
    samples : iterable of int
        Numbers of the samples; each must have a row.
    cluster : Cluster
        Where to compute.
    simulate : callable
        `engine.simulate`, or a function with the same parameters that takes its place.

    Returns
    -------
    RerunResult
        How many rows have which status, before and after.

    Raises
    ------
    SpecError
        If a sample has no row yet.
    WrongBuild
        If the campaign is planned for another build of clearcap.
    LeaseHeld
        If a process coordinates the campaign.
    WorkerDied, SchedulerLost, StoreError
        If a worker, the cluster or the store fails; the parts that are replaced stay.
    """
    batches = _by_batch(store, plan, samples)
    address = CampaignAddress.of(store, plan, simulate)
    before: Counter[str] = Counter()
    after: Counter[str] = Counter()
    with hold_lease(store, plan.campaign_id), connect_workers(cluster) as workers:
        for batch, selected in batches.items():
            workers.submit(f"rerun-{batch:06d}", rerun_batch, address, batch, tuple(selected))
        while (future := workers.next_finished()) is not None:
            statuses_before, statuses_after = future.result()
            before.update(statuses_before)
            after.update(statuses_after)
        store.record(plan, store.survey(plan).parts.values())
    return RerunResult(sum(after.values()), dict(sorted(before.items())), dict(sorted(after.items())))


def rerun_batch(address: CampaignAddress, batch: int, samples: tuple[int, ...]) -> tuple[Counts, Counts]:
    """Compute some rows of a batch again; return how many had and have which status.

    Parameters
    ----------
    address : CampaignAddress
        The campaign.
    batch : int
        Batch number.
    samples : tuple of int
        Samples of the batch, in order.
    """
    store, plan = open_campaign(address)
    rows = {row["sample"]: row for row in store.read_part(plan, batch).to_pylist()}
    old_rows = [rows[sample] for sample in samples]
    for old, new in zip(old_rows, rows_in_subprocess(address, samples, 1), strict=True):
        rows[new["sample"]] = _with_history(old, new)
    store.write_part(plan, batch, rows_to_table(plan, list(rows.values())))
    return _count_statuses(old_rows), _count_statuses([rows[sample] for sample in samples])


def _with_history(old: Row, new: Row) -> Row:
    """Return a new row that also tells the attempts of the old one that it replaces."""
    ending = f"{old['status']} ({old['message']})" if old["message"] else old["status"]
    earlier = "; ".join(filter(None, (old["earlier_attempts"], ending, new["earlier_attempts"])))
    return new | {"attempts": old["attempts"] + new["attempts"], "earlier_attempts": earlier}


def _count_statuses(rows: list[Row]) -> Counts:
    return dict(Counter(row["status"] for row in rows))


def _by_batch(store: Store, plan: Plan, samples: Iterable[int]) -> dict[int, list[int]]:
    """Return the samples by batch, each once and in order."""
    parts, batches = store.survey(plan).parts, defaultdict(list)
    first_samples = [first for first, _ in plan.batches]
    for sample in sorted(set(samples)):
        batch = bisect_right(first_samples, sample) - 1
        if batch not in parts or sample >= sum(plan.batches[batch]):
            raise SpecError(
                f"sample {sample}: campaign {plan.campaign_id} has no row of this sample; allowed:"
                f" computed samples from 0 to {plan.spec.samples - 1}; compute the others with:"
                f" {store.command('resume', plan.campaign_id)}"
            )
        batches[batch].append(sample)
    return dict(batches)
