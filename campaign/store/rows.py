"""Read rows in the order of the samples, piece by piece, from parts and merged files, even during a merge."""

import logging
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from campaign.plan_header import PlanHeader
from campaign.store.command_line import command_line
from campaign.store.files.files import Files
from campaign.store.parts import ROW_GROUP, BadPart, batches_of, file_name, folder, part_name
from campaign.store.survey import read_file

if TYPE_CHECKING:
    import pyarrow as pa

logger = logging.getLogger(__name__)


def files_by_batch(files: Files, plan: PlanHeader) -> dict[int, list[str]]:
    """Return the names of the files that hold each batch; see `holders`."""
    return holders(plan, files.names(folder(plan)))


def holders(plan: PlanHeader, names: Iterable[str]) -> dict[int, list[str]]:
    """Return the names of the files that hold each batch, in the order in which to try them.

    A batch's own part comes first, then the longest merged file.
    """
    spans = {name: span for name in names if (span := batches_of(name, plan))}
    by_batch: dict[int, list[str]] = {}
    for name in sorted(spans, key=lambda name: (name.startswith("rows"), spans[name][0] - spans[name][1], name)):
        for batch in range(spans[name][0], spans[name][1] + 1):
            by_batch.setdefault(batch, []).append(name)
    return by_batch


def read_batch(files: Files, plan: PlanHeader, batch: int) -> "pa.Table":
    """Return the rows of a batch; see `Store.read_part`."""
    reasons = []
    own_part = file_name(batch, batch)
    try:
        # tried without a listing, which on a shared folder may lag behind its files
        return read_file(files, plan, own_part)
    except FileNotFoundError:
        pass
    except BadPart as error:
        reasons.append(f"{error}")
    for name in files_by_batch(files, plan).get(batch, []):
        if name == own_part:
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


def stream(
    files: Files, plan: PlanHeader, end: int, columns: Sequence[str] | None, batches: Collection[int] | None = None
) -> "Iterator[pa.Table]":
    """Yield rows in the order of the samples; see `Store.stream`."""
    import pyarrow as pa

    pieces: list[pa.Table] = []
    for table in _tables_of_files(files, plan, end, columns, batches):
        pieces.append(table)
        if sum(map(len, pieces)) >= ROW_GROUP:  # join small files, because each table costs its reader time
            yield pa.concat_tables(pieces)
            pieces = []
    if pieces:
        yield pa.concat_tables(pieces)


def _tables_of_files(
    files: Files, plan: PlanHeader, end: int, columns: Sequence[str] | None, batches: Collection[int] | None
) -> "Iterator[pa.Table]":
    """Yield rows in the order of the samples, one table per file."""
    by_batch = _wanted(files_by_batch(files, plan), batches)
    batch, last = 0, max(number for number, (first, _) in enumerate(plan.batches) if first < end)
    listed_for = -1
    bad: set[str] = set()
    while batch <= last:
        names = [name for name in by_batch.get(batch, []) if name not in bad]
        if not names and listed_for != batch and batch in by_batch:  # its file was merged, or is bad: list anew
            by_batch, listed_for = _wanted(files_by_batch(files, plan), batches), batch
            continue
        if not names:
            batch += 1
            continue
        last_in_file = _last_from_file(by_batch, names[0], batch, last)
        try:
            table = cut(plan, names[0], read_file(files, plan, names[0], columns), batch, last_in_file)
        except FileNotFoundError:
            by_batch[batch].remove(names[0])
            continue
        except BadPart as error:
            command = command_line(files, "resume", plan.campaign_id)
            logger.warning("%s %s: left out; compute its samples again with: %s", names[0], error, command)
            bad.add(names[0])
            continue
        yield table.slice(0, end - plan.batches[batch][0])
        batch = last_in_file + 1


def _wanted(by_batch: dict[int, list[str]], batches: Collection[int] | None) -> dict[int, list[str]]:
    """Return the files of the wanted batches; None means all batches."""
    return by_batch if batches is None else {batch: by_batch[batch] for batch in batches if batch in by_batch}


def _last_from_file(by_batch: dict[int, list[str]], name: str, batch: int, last: int) -> int:
    """Return the last of the successive batches from ``batch`` on whose first choice is this file."""
    while batch < last and by_batch.get(batch + 1, [None])[0] == name:
        batch += 1
    return batch


def cut(plan: PlanHeader, name: str, table: "pa.Table", first: int, last: int) -> "pa.Table":
    """Return the rows of batches ``first`` to ``last`` from the table of a file."""
    begin = plan.batches[first][0]
    begin_of_file = plan.batches[(batches_of(name, plan) or (first, last))[0]][0]
    return table.slice(begin - begin_of_file, sum(plan.batches[last]) - begin)
