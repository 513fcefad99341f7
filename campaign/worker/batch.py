"""Compute a batch on a worker and write its part to the store; only counts travel back to the coordinator.

Every run becomes a row, however it ends. A run that kills its process takes the batch with it; the coordinator then
requests the batch again with its runs in an isolated subprocess, where the run at fault becomes a row too. A run whose
error may be the machine's is repeated in such a subprocess at once.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from time import perf_counter

from campaign.store import BadPart
from campaign.worker.messages import BatchRequest, BatchResult, CampaignAddress, DoubtfulRun
from campaign.worker.moments import moments
from campaign.worker.row import Row, repeats_to_table, rows_to_table
from campaign.worker.runs import open_campaign, open_repeats, rows_in_process
from campaign.worker.subprocess_runs import rows_in_subprocess


def run_batches(address: CampaignAddress, requests: Sequence[BatchRequest]) -> list[BatchResult]:
    """Compute batches one after the other; the parts written before an error stay. Errors are those of `run_batch`."""
    return [run_batch(address, request) for request in requests]


def run_batch(address: CampaignAddress, request: BatchRequest) -> BatchResult:
    """Compute a batch and the repeats of its samples, and write their parts, unless the store has them already.

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
    if request.has_rows:
        repeats = _repeats(address, request)
        return BatchResult(None, {}, computed=False, seconds=perf_counter() - start, repeats=repeats)
    try:
        table, computed = store.read_own_part(plan, request.batch), False
    except (FileNotFoundError, BadPart):
        first, count = plan.batches[request.batch]
        rows = _rows(address, range(first, first + count), request)
        table, computed = rows_to_table(plan, rows), True
    part = store.write_part(plan, request.batch, table)
    repeats = _repeats(address, request)
    return BatchResult(part, moments(table, plan.mechanism.responses), computed, perf_counter() - start, repeats)


def _repeats(address: CampaignAddress, request: BatchRequest) -> int:
    """Repeat samples of a batch, as far as the store lacks their repeats; return how many of them are repeated."""
    (store, plan), number = open_campaign(address), 0
    for repeats in open_repeats(address):
        batch = repeats.batch_of(request.batch)
        if batch is None:
            continue
        first, count = repeats.batches[batch]
        number += count
        try:
            store.read_part(repeats, batch)
        except (FileNotFoundError, BadPart):
            rows = _rows(replace(address, halved=True), repeats.numbers_of(first, first + count), request)
            store.write_part(repeats, batch, repeats_to_table(plan, repeats, rows))
    return number


def _rows(address: CampaignAddress, samples: Sequence[int], request: BatchRequest) -> list[Row]:
    """Return the rows of a batch, computed in this process unless it asks for another or a run casts a doubt."""
    if not request.isolated:
        with suppress(DoubtfulRun):
            return list(rows_in_process(address, samples, request.attempt))
    return list(rows_in_subprocess(address, samples, request.attempt))
