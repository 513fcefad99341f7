"""Compute a batch on a worker and write its part to the store; only counts travel back to the coordinator.

Every run becomes a row, however it ends. If a run kills its process, the batch is lost; the coordinator then requests
the batch again with its runs in an isolated subprocess, where the run at fault becomes a row too. If the machine may
have caused the error of a run, the run is repeated in such a subprocess at once.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from time import perf_counter

from campaign.store import BadPart
from campaign.worker.messages import BatchRequest, BatchResult, CampaignAddress, DoubtfulRun
from campaign.worker.moments import moments
from campaign.worker.row import Row, open_campaign, open_repeats, repeats_to_table, rows_in_process, rows_to_table
from campaign.worker.subprocess_runs import rows_in_subprocess


def run_batches(address: CampaignAddress, requests: Sequence[BatchRequest]) -> list[BatchResult]:
    """Compute batches one after the other; parts written before an error stay. Raises what `run_batch` raises."""
    return [run_batch(address, request) for request in requests]


def run_batch(address: CampaignAddress, request: BatchRequest) -> BatchResult:
    """Compute a batch and the repeats of its samples, and write their parts, unless the store has them already."""
    store, plan = open_campaign(address)
    start = perf_counter()
    if request.has_rows:
        repeats = _repeats(address, request)
        return BatchResult(None, {}, computed=False, seconds=perf_counter() - start, repeats=repeats)
    try:
        # there if an earlier attempt wrote it, but its answer was lost with the worker or the scheduler
        (part, table), computed = store.read_own_part(plan, request.batch), False
    except (FileNotFoundError, BadPart):
        first, count = plan.batches[request.batch]
        rows = _rows(address, range(first, first + count), request)
        table, computed = rows_to_table(plan, rows), True
        part = store.write_part(plan, request.batch, table)
    repeats = _repeats(address, request)
    return BatchResult(part, moments(table, plan.mechanism.responses), computed, perf_counter() - start, repeats)


def _repeats(address: CampaignAddress, request: BatchRequest) -> int:
    """Compute the repeats of a batch's samples that the store lacks; return the number of repeats of the batch."""
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
    """Return the rows of a batch, computed in this process unless isolation is requested or a run is doubtful."""
    if not request.isolated:
        with suppress(DoubtfulRun):
            return list(rows_in_process(address, samples, request.attempt))
    return list(rows_in_subprocess(address, samples, request.attempt))
