"""Compute rows in this process, one run after the other."""

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache

from campaign.compiling import load_engine
from campaign.plan import Plan
from campaign.repeat_plan import RepeatPlan, plan_repeats
from campaign.store import Store, open_store
from campaign.store.layout import CANCEL
from campaign.worker.halved_step import HalvedStep
from campaign.worker.limits import cancelled_by, memory_limit
from campaign.worker.messages import CampaignAddress, Cancelled, DoubtfulRun, check_build
from campaign.worker.row import DoubtfulRow, Row, compute_row, sample_inputs
from engine import simulate


@lru_cache(maxsize=4)
def open_campaign(address: CampaignAddress) -> tuple[Store, Plan]:
    """Return the store and the plan of a campaign after compiling the engine, for a process that computes rows.

    Raises what `read_campaign` raises.
    """
    check_build(address.campaign_id, address.row_build)
    if address.simulate is simulate:
        load_engine()
    return read_campaign(address)


@lru_cache(maxsize=4)
def read_campaign(address: CampaignAddress) -> tuple[Store, Plan]:
    """Return the store and the plan of a campaign, read once per process; the engine need not be compiled.

    Raises WrongBuild if this process runs another build than the campaign is planned for, StoreError if the store or
    the plan cannot be read.
    """
    check_build(address.campaign_id, address.row_build)
    store = open_store(address.store, address.retry_policy)
    return store, store.plan(address.campaign_id)


@lru_cache(maxsize=4)
def open_repeats(address: CampaignAddress) -> tuple[RepeatPlan, ...]:
    """Return the sets of repeats of a campaign; raises the same errors as `open_campaign`."""
    return plan_repeats(open_campaign(address)[1], address.repeats)


def rows_in_process(
    address: CampaignAddress,
    samples: Sequence[int],
    attempt: int = 1,
    begin: Callable[[int], None] = lambda _: None,
) -> Iterator[Row]:
    """Yield the row of each sample, in order, computed in this process.

    ``attempt`` is that of the batch, from 1; ``begin`` is called with each sample before its run begins. Raises
    Cancelled if the campaign is cancelled meanwhile, DoubtfulRun if a run raises an error that the machine may have
    caused, and what `open_campaign` raises.
    """
    from engine.loop import Cancel  # loads numba, which a coordinator that only requests batches does not need

    store, plan = open_campaign(address)
    run, cancel = HalvedStep(address.simulate) if address.halved else address.simulate, Cancel()
    marker, files = f"{plan.campaign_id}/{CANCEL}", store.files.hasty
    with memory_limit(plan.spec.execution.memory_limit), cancelled_by(lambda: files.exists(marker), cancel):
        for sample, values in sample_inputs(plan, samples):
            begin(sample)
            row = compute_row(plan, run, sample, values, attempt, cancel)
            if cancel.flag[0]:
                # not a row: the flag has cut the run short
                raise Cancelled(f"campaign {plan.campaign_id} is cancelled")
            if isinstance(row, DoubtfulRow):
                raise DoubtfulRun(row)
            yield row
