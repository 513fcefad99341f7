"""Compute rows again: runs that crashed or timed out for a reason that is mended by now."""

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from distributed import as_completed

from campaign.cluster.cluster import Cluster
from campaign.cluster.connect import connect
from campaign.coordinator.lease import hold_lease
from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.store import Store
from campaign.worker.messages import CampaignAddress, Simulate
from campaign.worker.row import Row, rows_to_table
from campaign.worker.runs import open_campaign
from campaign.worker.subprocess_runs import rows_in_subprocess
from engine import simulate


@dataclass(frozen=True)
class RerunResult:
    """Rows that were computed again.

    Attributes
    ----------
    samples : int
        How many.
    before, after : dict of str to int
        Their statuses.
    """

    samples: int
    before: dict[str, int]
    after: dict[str, int]

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def failed_samples(store: Store, plan: Plan, statuses: Iterable[str] = ()) -> list[int]:
    """Return the samples whose run did not succeed, or ended in one of ``statuses``, in order."""
    wanted, samples = set(statuses), []
    for table in store.stream(plan, ["sample", "status"]):
        rows = zip(table["sample"].to_pylist(), table["status"].to_pylist(), strict=True)
        samples += [sample for sample, status in rows if (status in wanted if wanted else status != "ok")]
    return samples


def rerun(
    store: Store, plan: Plan, samples: Iterable[int], cluster: Cluster, simulate: Simulate = simulate
) -> RerunResult:
    """Compute rows again, each batch's in a process of their own; its part is replaced as a whole.

    Parameters
    ----------
    store : Store
        Where the rows are.
    plan : Plan
        The campaign.
    samples : iterable of int
        Which; each must have a row.
    cluster : Cluster
        Where to compute.
    simulate : callable
        `engine.simulate`, or what stands in its place.

    Raises
    ------
    SpecError
        If a sample has no row yet.
    LeaseHeld
        If a process drives the campaign.
    """
    batches = _by_batch(store, plan, samples)
    task = CampaignAddress.of(store, plan, simulate)
    before: Counter[str] = Counter()
    after: Counter[str] = Counter()
    with hold_lease(store, plan.campaign_id), connect(cluster) as client:
        futures = [client.submit(rerun_batch, task, b, tuple(asked), pure=False) for b, asked in batches.items()]
        for future in as_completed(futures, loop=client.loop):
            was, is_now = future.result()
            before.update(was)
            after.update(is_now)
            future.release()
        store.record(plan, store.survey(plan).parts.values())
    return RerunResult(sum(after.values()), dict(sorted(before.items())), dict(sorted(after.items())))


def rerun_batch(task: CampaignAddress, batch: int, samples: tuple[int, ...]) -> tuple[dict[str, int], dict[str, int]]:
    """Compute some rows of a batch again; return their statuses before and after."""
    store, plan = open_campaign(task)
    rows = {row["sample"]: row for row in store.read_part(plan, batch).to_pylist()}
    old = [rows[sample] for sample in samples]
    for row, new in zip(old, rows_in_subprocess(task, samples, 1), strict=True):
        rows[new["sample"]] = _with_history(row, new)
    store.write_part(plan, batch, rows_to_table(plan, list(rows.values())))
    return _statuses(old), _statuses([rows[sample] for sample in samples])


def _with_history(old: Row, new: Row) -> Row:
    """Return a row that remembers the one in whose place it comes."""
    was = f"{old['status']} ({old['message']})" if old["message"] else old["status"]
    earlier = "; ".join(filter(None, (old["earlier_attempts"], was, new["earlier_attempts"])))
    return new | {"attempts": old["attempts"] + new["attempts"], "earlier_attempts": earlier}


def _statuses(rows: list[Row]) -> dict[str, int]:
    return dict(Counter(row["status"] for row in rows))


def _by_batch(store: Store, plan: Plan, samples: Iterable[int]) -> dict[int, list[int]]:
    """Return the samples by batch, each once and in order."""
    there, batches = store.survey(plan).parts, defaultdict(list)
    firsts = [first for first, _ in plan.batches]
    for sample in sorted(set(samples)):
        batch = bisect_right(firsts, sample) - 1
        if batch not in there or sample >= sum(plan.batches[batch]):
            raise SpecError(
                f"sample {sample}: campaign {plan.campaign_id} has no row of it; allowed: 0 to"
                f" {plan.spec.samples - 1}, as far as they are computed; clearcap resume computes the others"
            )
        batches[batch].append(sample)
    return dict(batches)
