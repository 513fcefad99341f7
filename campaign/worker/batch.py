"""Compute a batch on a worker and write its part to the store; only counts travel back to the coordinator.

Every run becomes a row, however it ends. A run that kills its process takes the batch with it; the coordinator then
requests the batch again with its runs in an isolated subprocess, where the run at fault becomes a row too. A run whose
error may be the machine's is repeated in such a subprocess at once.
"""

from collections.abc import Sequence
from contextlib import suppress
from time import perf_counter

from campaign.store import BadPart
from campaign.worker.messages import BatchRequest, BatchResult, CampaignAddress, DoubtfulRun
from campaign.worker.moments import moments
from campaign.worker.row import Row, rows_to_table
from campaign.worker.runs import open_campaign, rows_in_process
from campaign.worker.subprocess_runs import rows_in_subprocess


def run_batches(address: CampaignAddress, requests: Sequence[BatchRequest]) -> list[BatchResult]:
    """Compute batches one after the other; the parts written before an error stay. Errors are those of `run_batch`."""
    return [run_batch(address, request) for request in requests]


def run_batch(address: CampaignAddress, request: BatchRequest) -> BatchResult:
    """Compute a batch and write its part, unless the store has its rows already.

    Parameters
    ----------
    address : CampaignAddress
        The campaign.
    request : BatchRequest
        The batch.

    Returns
    -------
    BatchResult
        What the part holds.

    Raises
    ------
    WrongBuild
        If this process runs another build of clearcap than the campaign is planned for.
    Cancelled
        If the campaign is cancelled meanwhile.
    StoreError
        If the store fails.
    ChildFailed
        If the process that computes the runs in isolation fails again and again.
    """
    store, plan = open_campaign(address)
    start = perf_counter()
    try:
        table, computed = store.read_own_part(plan, request.batch), False
    except (FileNotFoundError, BadPart):
        first, count = plan.batches[request.batch]
        rows = _rows(address, range(first, first + count), request)
        table, computed = rows_to_table(plan, rows), True
    part = store.write_part(plan, request.batch, table)
    return BatchResult(part, moments(table, plan.mechanism.responses), computed, perf_counter() - start)


def _rows(address: CampaignAddress, samples: range, request: BatchRequest) -> list[Row]:
    """Return the rows of a batch, computed in this process unless it asks for another or a run casts a doubt."""
    if not request.isolated:
        with suppress(DoubtfulRun):
            return list(rows_in_process(address, samples, request.attempt))
    return list(rows_in_subprocess(address, samples, request.attempt))
