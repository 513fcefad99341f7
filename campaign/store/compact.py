"""Merge parts into files of about 100,000 rows: the same rows, read twenty times as fast.

A merged file is written whole and read back before any file that it replaces is removed, so every row is in the store
at least once even if the process is killed. Readers take each row once: from the batch's own part if it exists, else
from the longest merged file.
"""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

import pyarrow as pa

from campaign.errors import StoreError
from campaign.plan_header import PlanHeader
from campaign.store.files.files import Files
from campaign.store.parts import BadPart, Part, batches_of, encode, file_name, folder
from campaign.store.rows import cut
from campaign.store.survey import check_file, read_file, survey

ROWS = 100_000  # of a merged file: samples 0 to 99,999, and so on
logger = logging.getLogger(__name__)


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
        return part.batch - position, plan.batches[part.batch][0] // ROWS

    for _, group in groupby(enumerate(parts[batch] for batch in sorted(parts)), key=run_and_block):
        yield [part for _, part in group]


def _merge(files: Files, plan: PlanHeader, run: list[Part], target: str) -> list[Part]:
    """Write the rows of a run of batches into one file, read it back, and return its parts."""
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
