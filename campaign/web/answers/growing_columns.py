"""Columns of a campaign that is still computed: those of an earlier look grow by the rows that came since.

What each batch's rows come from is kept beside the columns. Where that is as it was, the rows are too; only the rest is
read from the store. So the columns are always those that reading all rows would give, to the bit.
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

Sources = Mapping[int, str]  # of each batch that has files: a digest of their names and stamps


@dataclass(frozen=True)
class SourcedColumns:
    """Columns, and what they come from.

    Attributes
    ----------
    columns : SampleColumns
        The samples, in their order.
    sources : dict of int to str
        See `sources_of`.
    """

    columns: SampleColumns
    sources: Sources


def grown_columns(store: Store, plan: Plan, earlier: SourcedColumns | None) -> SourcedColumns:
    """Return the columns of a campaign as they are now.

    Parameters
    ----------
    store : Store
        Where it is.
    plan : Plan
        The campaign.
    earlier : SourcedColumns or None
        What an earlier look returned; None: all rows are read.

    Raises
    ------
    CampaignError
        If there are no rows.
    StoreError
        If the store cannot be read.
    """
    sources = sources_of(store, plan)  # before the rows: what is replaced meanwhile is read again the next time
    kept = {} if earlier is None or list(earlier.columns.values) != column_names(plan) else earlier.sources
    same = {batch for batch, source in kept.items() if sources.get(batch) == source}
    columns = samples_in(plan, store.stream(plan, ["sample", *column_names(plan)], sources.keys() - same))
    if earlier is not None and same:
        columns = _merged(_rows_of(plan, earlier.columns, same), columns)
    if not columns.number.size:
        raise no_samples(plan)
    return SourcedColumns(columns, sources)


def sources_of(store: Store, plan: Plan) -> Sources:
    """Return of each batch a digest of what its rows come from: files with their stamps, and where the table ends."""
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
    """Return samples of different batches in their order."""
    number = np.concatenate([some.number, others.number])
    order = np.argsort(number, kind="stable")
    values = {name: np.concatenate([column, others.values[name]])[order] for name, column in some.values.items()}
    return SampleColumns(number[order], values)
