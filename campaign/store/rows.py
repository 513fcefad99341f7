"""Rows in the order of the samples, some at a time, wherever they are and while they are being merged."""

import logging
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from campaign.plan_header import PlanHeader
from campaign.store.files.files import Files
from campaign.store.parts import ROW_GROUP, BadPart, batches_of, folder, part_name
from campaign.store.survey import read_file

if TYPE_CHECKING:
    import pyarrow as pa

logger = logging.getLogger(__name__)


def holders(files: Files, plan: PlanHeader) -> dict[int, list[str]]:
    """Return for each batch the names of the files that hold it, the one to read first: its own, then the longest."""
    spans = {name: span for name in files.names(folder(plan)) if (span := batches_of(name, plan))}
    held: dict[int, list[str]] = {}
    for name in sorted(spans, key=lambda name: (name.startswith("rows"), spans[name][0] - spans[name][1], name)):
        for batch in range(spans[name][0], spans[name][1] + 1):
            held.setdefault(batch, []).append(name)
    return held


def batch_rows(files: Files, plan: PlanHeader, batch: int) -> "pa.Table":
    """Return the rows of a batch; see `Store.read_part`."""
    reasons = []
    own = part_name(plan, batch).rsplit("/", 1)[-1]
    try:
        return read_file(files, plan, own)
    except FileNotFoundError:
        pass
    except BadPart as error:
        reasons.append(f"{error}")
    for name in holders(files, plan).get(batch, []):
        if name == own:
            continue
        try:
            return cut(plan, name, read_file(files, plan, name), batch, batch)
        except FileNotFoundError:
            continue
        except BadPart as error:
            reasons.append(f"{name} {error}")
    if reasons:
        raise BadPart("; ".join(reasons))
    raise FileNotFoundError(part_name(plan, batch))


def stream(files: Files, plan: PlanHeader, end: int, columns: Sequence[str] | None) -> "Iterator[pa.Table]":
    """Yield rows in the order of the samples; see `Store.stream`."""
    import pyarrow as pa

    pieces: list[pa.Table] = []
    for table in _by_file(files, plan, end, columns):
        pieces.append(table)
        if sum(map(len, pieces)) >= ROW_GROUP:  # small files together: each table has its price for whoever reads it
            yield pa.concat_tables(pieces)
            pieces = []
    if pieces:
        yield pa.concat_tables(pieces)


def _by_file(files: Files, plan: PlanHeader, end: int, columns: Sequence[str] | None) -> "Iterator[pa.Table]":
    """Yield rows in the order of the samples, a file at a time."""
    held = holders(files, plan)
    batch, last = 0, max(number for number, (first, _) in enumerate(plan.batches) if first < end)
    listed_for = -1
    bad: set[str] = set()
    while batch <= last:
        names = [name for name in held.get(batch, []) if name not in bad]
        if not names and listed_for != batch and batch in held:  # its file was merged since, or is bad: look again
            held, listed_for = holders(files, plan), batch
            continue
        if not names:
            batch += 1
            continue
        to = _until(plan, held, names[0], batch, last)
        try:
            table = cut(plan, names[0], read_file(files, plan, names[0], columns), batch, to)
        except FileNotFoundError:
            held[batch].remove(names[0])
            continue
        except BadPart as error:
            logger.warning("%s %s: left out; run the campaign again to replace it", names[0], error)
            bad.add(names[0])
            continue
        yield table.slice(0, end - plan.batches[batch][0])
        batch = to + 1


def _until(plan: PlanHeader, held: dict[int, list[str]], name: str, batch: int, last: int) -> int:
    """Return the last of the batches from ``batch`` on that are best read from this file."""
    to = batch
    while to < last and held.get(to + 1, [None])[0] == name:
        to += 1
    return to


def cut(plan: PlanHeader, name: str, table: "pa.Table", first: int, last: int) -> "pa.Table":
    """Return the rows of batches ``first`` to ``last`` from the table of a file."""
    begin = plan.batches[first][0]
    begin_of_file = plan.batches[(batches_of(name, plan) or (first, last))[0]][0]
    return table.slice(begin - begin_of_file, sum(plan.batches[last]) - begin)
