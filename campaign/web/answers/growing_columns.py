"""Columns of a running campaign, which are extended by the rows that were stored since the last look.

The source of each batch's rows is kept beside the columns. Batches with an unchanged source have unchanged rows; only
the other batches are read from the store. The columns are bit for bit those that reading all rows would give.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from campaign.plan import Plan
from campaign.reports.samples import SampleColumns, column_names, no_samples, samples_in
from campaign.store import Store
from campaign.store.parts import folder
from campaign.store.rows import holders

Sources = Mapping[int, str]  # for each batch with files, a digest of their names and stamps


@dataclass(frozen=True)
class SourcedColumns:
    """Columns and their sources."""

    columns: SampleColumns  # sorted by number of sample
    sources: Sources  # see `sources_of`


def grown_columns(store: Store, plan: Plan, earlier: SourcedColumns | None) -> SourcedColumns:
    """Return the current columns of a campaign; take what has not changed from the result of an earlier call, if any.

    Raises CampaignError if there are no rows.
    """
    sources = sources_of(store, plan)  # before the rows, so that batches replaced meanwhile are read again next time
    kept = {} if earlier is None or list(earlier.columns.values) != column_names(plan) else earlier.sources
    same = {batch for batch, source in kept.items() if sources.get(batch) == source}
    columns = samples_in(plan, store.stream(plan, ["sample", *column_names(plan)], sources.keys() - same))
    if earlier is not None and same:
        columns = _merged(_rows_of(plan, earlier.columns, same), columns)
    if not columns.number.size:
        raise no_samples(plan)
    return SourcedColumns(columns, sources)


def sources_of(store: Store, plan: Plan) -> Sources:
    """Return for each batch a digest of its rows' source: the files with their stamps, and the end of the table."""
    stamps, end = store.files.stamps(folder(plan)), store.end(plan)
    sources = {}
    for batch, names in sorted(holders(plan, stamps).items()):
        first, count = plan.batches[batch]
        source = f"{max(0, min(count, end - first))} {[(name, stamps[name]) for name in names]}"
        sources[batch] = hashlib.sha256(source.encode()).hexdigest()[:16]
    return sources


def _rows_of(plan: Plan, columns: SampleColumns, batches: set[int]) -> SampleColumns:
    """Return the samples of some batches."""
    starts = [first for first, _ in plan.batches]
    kept = np.isin(np.searchsorted(starts, columns.number, side="right") - 1, sorted(batches))
    return SampleColumns(columns.number[kept], {name: column[kept] for name, column in columns.values.items()})


def _merged(some: SampleColumns, others: SampleColumns) -> SampleColumns:
    """Return the samples of two sets of batches, sorted by number."""
    number = np.concatenate([some.number, others.number])
    order = np.argsort(number, kind="stable")
    values = {name: np.concatenate([column, others.values[name]])[order] for name, column in some.values.items()}
    return SampleColumns(number[order], values)
