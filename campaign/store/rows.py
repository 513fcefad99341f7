"""The rows of a campaign in their files: read in the order of the samples, merged, and quarantined.

They are read piece by piece from parts and merged files, even during a merge.
"""

import logging
from collections import deque
from collections.abc import Collection, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from campaign.errors import StoreError, file_gone
from campaign.plan_header import PlanHeader
from campaign.store.files.files import Files
from campaign.store.files.several import READERS
from campaign.store.parts import (
    ROW_GROUP,
    BadPart,
    Part,
    batches_of,
    check_file,
    encode,
    file_name,
    folder,
    part_name,
    read_file,
)
from campaign.store.survey import survey

if TYPE_CHECKING:
    import pyarrow as pa

MERGED_ROWS = 100_000  # of a merged file: samples 0 to 99,999, and so on
logger = logging.getLogger(__name__)


def files_by_batch(files: Files, plan: PlanHeader) -> dict[int, list[str]]:
    """Return the names of the files that hold each batch; see `holders`."""
    return holders(plan, files.names(folder(plan)))


def holders(plan: PlanHeader, names: Iterable[str]) -> dict[int, list[str]]:
    """Return the names of the files that hold each batch: its own part first, then the longest merged file."""
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
    raise file_gone(part_name(plan, batch))


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
    batch, last = 0, plan.batches_before(end) - 1
    listed_for = -1
    bad: set[str] = set()
    first_choices = dict.fromkeys(by_batch[number][0] for number in range(last + 1) if number in by_batch)
    with nullcontext(files) if files.local else _ReadAhead(files, plan, first_choices) as source:
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
                table = cut(plan, names[0], read_file(source, plan, names[0], columns), batch, last_in_file)
            except FileNotFoundError:
                by_batch[batch].remove(names[0])
                continue
            except BadPart as error:
                command = files.command("resume", plan.campaign_id)
                logger.warning("%s %s: left out; compute its samples again with: %s", names[0], error, command)
                bad.add(names[0])
                continue
            yield table.slice(0, end - plan.batches[batch][0])
            batch = last_in_file + 1


class _ReadAhead:
    """Parts behind a URL, read before they are asked for and several at a time, because an object store answers slowly.

    They are asked for in the order of the names; merged files, which are large, are not read ahead.
    """

    def __init__(self, files: Files, plan: PlanHeader, names: Iterable[str]) -> None:
        self._files, self._pool = files, ThreadPoolExecutor(READERS)
        self._paths = deque(f"{folder(plan)}/{name}" for name in names if not name.startswith("rows"))
        self._begun: dict[str, Future[bytes]] = {}

    def read(self, name: str) -> bytes:
        """Return the content of a file, as `Files.read` does."""
        while name in self._begun and next(iter(self._begun)) != name:  # files that nobody asked for
            del self._begun[next(iter(self._begun))]
        begun = self._begun.pop(name, None)
        while self._paths and len(self._begun) < READERS:
            path = self._paths.popleft()
            if path != name:
                self._begun[path] = self._pool.submit(self._files.hasty.read, path)
        try:
            return begun.result() if begun else self._files.read(name)
        except (StoreError, FileNotFoundError):  # a thread tries once, this one for as long as the policy allows
            return self._files.read(name)

    def __enter__(self) -> "_ReadAhead":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)


def _wanted(by_batch: dict[int, list[str]], batches: Collection[int] | None) -> dict[int, list[str]]:
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


# -- merging -----------------------------------------------------------------------------------------------------------
#
# Parts are merged into files of about 100,000 rows: the same rows, read twenty times as fast.
#
# A merged file is written whole and read back before any file that it replaces is removed, so every row is in the store
# at least once even if the process is killed. Readers take each row once: from the batch's own part if it exists, else
# from the longest merged file.


@dataclass(frozen=True)
class Compacted:
    """Result of merging the parts of a campaign."""

    written: list[str]  # merged files, relative to the folder of the parts
    removed: int  # number of files that they replace
    files: int  # number of sound files of rows after merging
    bad: dict[int, str]  # what is wrong, by batch, with bad files, which stay as they are
    parts: dict[int, Part]  # where the rows of each batch are now


def compact(files: Files, plan: PlanHeader) -> Compacted:
    """Merge the parts of a campaign; see `Store.compact`."""
    # all rows, also those after the end of a campaign that the stopping rule ended
    before = survey(files, plan, sum(plan.batches[-1]), verify=False)
    parts, written, removed = dict(before.parts), [], 0
    for run in runs(plan, before.parts):
        target = file_name(run[0].batch, run[-1].batch, merged=True)
        if {part.file for part in run} != {target} and len(run) > 1:
            try:
                merged = _merge(files, plan, run, target)
            except (FileNotFoundError, BadPart) as error:
                logger.warning(
                    "%s was not written, because one of its parts changed during the merge: %s", target, error
                )
                continue
            written.append(target)
            parts.update((part.batch, part) for part in merged)
        # even if nothing was merged: an earlier call may have been killed before it removed what it had replaced
        if parts[run[0].batch].file == target:
            removed += _remove_replaced(files, plan, target)
    return Compacted(written, removed, len({part.file for part in parts.values()}), before.bad, parts)


def runs(plan: PlanHeader, parts: dict[int, Part]) -> Iterator[list[Part]]:
    """Yield the parts of each merged file: successive batches that begin in the same 100,000 samples."""

    def run_and_block(numbered: tuple[int, Part]) -> tuple[int, int]:
        position, part = numbered
        # the difference stays the same along successive batches, and grows at a gap
        return part.batch - position, plan.batches[part.batch][0] // MERGED_ROWS

    for _, group in groupby(enumerate(parts[batch] for batch in sorted(parts)), key=run_and_block):
        yield [part for _, part in group]


def _merge(files: Files, plan: PlanHeader, run: list[Part], target: str) -> list[Part]:
    """Write the rows of a run of batches into one file, read it back, and return its parts."""
    import pyarrow as pa

    pieces = []
    for name, group in groupby(run, key=lambda part: part.file):
        batches = [part.batch for part in group]
        pieces.append(cut(plan, name, read_file(files, plan, name), batches[0], batches[-1]))
    rows = pa.concat_tables(pieces)
    files.write(f"{folder(plan)}/{target}", encode(plan, rows, run[0].batch, run[-1].batch))
    written = read_file(files, plan, target)
    if not written.combine_chunks().equals(rows.combine_chunks()):
        raise StoreError(
            f"store {files.url}: {target} does not read back as it was written; its parts are kept. Check the disk"
        )
    return check_file(files, plan, target)


def _remove_replaced(files: Files, plan: PlanHeader, target: str) -> int:
    """Remove the sound files whose batches are all in a merged file; return the number of removed files."""
    first, last = batches_of(target, plan) or (0, -1)
    removed = 0
    for name in files.names(folder(plan)):
        span = batches_of(name, plan)
        if name == target or span is None or not first <= span[0] <= span[1] <= last:
            continue
        try:
            # a bad file is left for the campaign, which quarantines it
            check_file(files, plan, name)
        except (FileNotFoundError, BadPart):
            continue
        files.remove(f"{folder(plan)}/{name}")
        removed += 1
    return removed


# -- quarantine --------------------------------------------------------------------------------------------------------


def quarantine(files: Files, plan: PlanHeader, bad: Iterable[int]) -> list[str]:
    """Rename the bad files of some batches; see `Store.quarantine`."""
    by_batch, moved = files_by_batch(files, plan), []
    suspects = dict.fromkeys(name for batch in bad for name in by_batch.get(batch, []))
    taken = set(files.names(folder(plan))) if suspects else set()
    for name in suspects:
        try:
            check_file(files, plan, name)
        except FileNotFoundError:
            continue
        except BadPart as error:
            new = _free_name(f"{name}.bad", taken)
            taken.add(new)
            files.move(f"{folder(plan)}/{name}", f"{folder(plan)}/{new}")
            moved.append(new)
            logger.warning("%s/%s %s: quarantined as %s and computed again", folder(plan), name, error, new)
    return moved


def _free_name(name: str, taken: set[str]) -> str:
    """Return the name, or the first of ``name-2``, ``name-3``, ... that is not taken."""
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}-{number}"
    return free
