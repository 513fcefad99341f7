"""Compute rows again, for runs that crashed or timed out for a reason that has been fixed."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Set
from dataclasses import asdict, dataclass, replace
from typing import Any

from campaign.cluster.cluster import Cluster
from campaign.cluster.workers import compile_first, connect_workers
from campaign.coordinator.lease import LeaseHeld, hold_lease
from campaign.coordinator.requests import refuse_signed, rerun_request
from campaign.coordinator.state import write_state
from campaign.errors import CampaignError, SpecError, StoreError, UnreachableError
from campaign.plan import Plan
from campaign.plan_header import PlanHeader, RepeatPlan, plan_repeats
from campaign.store import Store
from campaign.store.layout import RERUN
from campaign.store.store import repeat_plans, repeated_shares
from campaign.worker.batch import rows_in_subprocess
from campaign.worker.messages import CampaignAddress, Simulate
from campaign.worker.row import Row, open_campaign, open_repeats, repeats_to_table, rows_to_table
from engine import simulate
from engine import simulate as engine_simulate

Counts = dict[str, int]


@dataclass(frozen=True)
class RerunResult:
    """Rows that were computed again."""

    samples: int  # number of rows
    before: Counts  # number of rows by status
    after: Counts  # the same afterwards
    repeats: Counts  # number of repeats computed again, by status afterwards

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def failed_samples(store: Store, plan: PlanHeader, statuses: Iterable[str] = ()) -> list[int]:
    """Return, in order, the samples whose run, or repeat, has one of ``statuses``, by default those that failed."""
    selected, samples = set(statuses), []
    for table in store.stream(plan, ["sample", "status"]):
        rows = zip(table["sample"].to_pylist(), table["status"].to_pylist(), strict=True)
        samples += [s for s, status in rows if (status in selected if selected else plan.is_failed(status))]
    return samples


def rerun(
    store: Store,
    plan: Plan,
    samples: Iterable[int],
    cluster: Cluster,
    simulate: Simulate = simulate,
    repeated: Iterable[int] = (),
    begun: Callable[[], None] = lambda: None,
) -> RerunResult:
    """Compute rows, and stored repeats, again in isolated subprocesses, and replace the parts of their batches."""
    # ``begun`` is called once the lease is held and the workers are connected. Parts that have been replaced stay,
    # whatever fails; SpecError if a sample has no row yet.
    batches = _by_batch(store, plan, samples)
    address = CampaignAddress.of(store, plan, simulate, repeated_shares(store, plan))
    sets = plan_repeats(plan, address.repeats)
    wanted = set(repeated)
    again = [_by_batch(store, repeats, _there(store, repeats, wanted)) for repeats in sets]
    before, after, of_repeats = Counter[str](), Counter[str](), Counter[str]()
    with hold_lease(store, plan.campaign_id), connect_workers(cluster) as workers:
        refuse_signed(store, plan.campaign_id)
        begun()
        if cluster.starts_here and simulate is engine_simulate:
            compile_first(workers)
        for table, of_table in zip((plan, *sets), (batches, *again), strict=True):
            _forget(store, table, of_table.keys())
        for batch, selected in batches.items():
            workers.submit(f"rerun-{batch:06d}", rerun_batch, address, batch, tuple(selected))
        for at, of_set in enumerate(again):
            for batch, selected in of_set.items():
                workers.submit(f"rerun-{at}-{batch:06d}", rerun_repeats, address, at, batch, tuple(selected))
        while (future := workers.next_finished()) is not None:
            if isinstance(done := future.result(), dict):
                of_repeats.update(done)
            else:
                before.update(done[0])
                after.update(done[1])
        for table in (plan, *sets):
            store.record(table, store.survey(table).parts.values())
    counts = [dict(sorted(counted.items())) for counted in (before, after, of_repeats)]
    return RerunResult(sum(after.values()), *counts)


def _forget(store: Store, table: PlanHeader, batches: Set[int]) -> None:
    """Take batches out of the manifest: it would vouch for the rows before if a part had the same size after."""
    if batches:
        parts = store.survey(table).parts
        store.record(table, [part for batch, part in parts.items() if batch not in batches])


def rerun_requested(store: Store, plan: Plan, cluster: Cluster, simulate: Simulate = simulate) -> RerunResult | None:
    """Compute failed rows again if the store holds a request for this; return None if it does not."""
    # The request is removed at the end, so that after a coordinator is killed, the next one starts again; rows that are
    # ok by then stay. After an error the request stays if another attempt may succeed; if not, the state says why.
    asked = rerun_request(store, plan.campaign_id)
    if asked is None:
        return None
    samples = failed_samples(store, plan, asked.statuses)
    repeated = {s for table in repeat_plans(store, plan) for s in failed_samples(store, table, asked.statuses)}
    message = f"{len(samples)} failed rows are computed again"
    try:
        result = RerunResult(0, {}, {}, {})
        if samples or repeated:
            result = rerun(
                store, plan, samples, cluster, simulate, repeated,
                lambda: write_state(store, plan.campaign_id, "running", message),
            )  # fmt: skip
    except (LeaseHeld, StoreError, UnreachableError):
        raise
    except CampaignError as error:
        store.remove(plan.campaign_id, RERUN)
        write_state(store, plan.campaign_id, "failed", str(error))
        raise
    store.remove(plan.campaign_id, RERUN)
    return result


def rerun_batch(address: CampaignAddress, batch: int, samples: tuple[int, ...]) -> tuple[Counts, Counts]:
    """Compute some rows of a batch again, given in order; return their numbers by status, before and after."""
    store, plan = open_campaign(address)
    rows, counts = _replaced(store, plan, batch, samples, address)
    store.write_part(plan, batch, rows_to_table(plan, rows))
    return counts


def rerun_repeats(address: CampaignAddress, at: int, batch: int, samples: tuple[int, ...]) -> Counts:
    """Compute some repeats of a batch of the set at position ``at`` again; return their new numbers by status."""
    (store, plan), repeats = open_campaign(address), open_repeats(address)[at]
    rows, (_, after) = _replaced(store, repeats, batch, samples, replace(address, halved=True))
    store.write_part(repeats, batch, repeats_to_table(plan, repeats, rows))
    return after


def _replaced(
    store: Store, table: PlanHeader, batch: int, samples: tuple[int, ...], address: CampaignAddress
) -> tuple[list[Row], tuple[Counts, Counts]]:
    """Return the rows of a batch, some computed again, and the numbers of these by status, before and after."""
    rows = {row["sample"]: row for row in store.read_part(table, batch).to_pylist()}
    old_rows = [rows[sample] for sample in samples]
    for old, new in zip(old_rows, rows_in_subprocess(address, samples, 1), strict=True):
        rows[new["sample"]] = _with_history(old, new)
    return list(rows.values()), (_count_statuses(old_rows), _count_statuses([rows[sample] for sample in samples]))


def _with_history(old: Row, new: Row) -> Row:
    """Return a new row that also lists the attempts of the old row that it replaces."""
    ending = f"{old['status']} ({old['message']})" if old["message"] else old["status"]
    earlier = "; ".join(filter(None, (old["earlier_attempts"], ending, new["earlier_attempts"])))
    return new | {"attempts": old["attempts"] + new["attempts"], "earlier_attempts": earlier}


def _count_statuses(rows: list[Row]) -> Counts:
    return dict(Counter(row["status"] for row in rows))


def _there(store: Store, repeats: RepeatPlan, wanted: set[int]) -> list[int]:
    """Return the wanted samples whose repeats in a set are in the store."""
    if not wanted:
        return []
    return [s for table in store.stream(repeats, ["sample"]) for s in table["sample"].to_pylist() if s in wanted]


def _by_batch(store: Store, table: PlanHeader, samples: Iterable[int]) -> dict[int, list[int]]:
    """Return the samples by batch, each once and in order."""
    parts, batches = store.survey(table).parts, defaultdict(list)
    for sample in sorted(set(samples)):
        row = table.rows_before(sample)
        batch = table.batches_before(row + 1) - 1
        if batch not in parts or row >= sum(table.batches[batch]):
            raise SpecError(
                f"sample {sample}: campaign {table.campaign_id} has no row of this sample; allowed:"
                f" computed samples from 0 to {table.all_samples - 1}; compute the others with:"
                f" {store.command('resume', table.campaign_id)}"
            )
        batches[batch].append(sample)
    return dict(batches)
