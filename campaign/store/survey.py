"""The survey: which parts and rows of a plan a store holds.

It takes a listing, the manifest, and the files that the manifest lacks.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from campaign.plan_header import PlanHeader
from campaign.store.files.files import Files
from campaign.store.files.several import read_several
from campaign.store.manifest import load_manifest
from campaign.store.parts import BadPart, Part, batches_of, check_file, folder, read_file, total


@dataclass(frozen=True)
class Survey:
    """The parts and rows of a plan that a store holds."""

    parts: dict[int, Part]  # sound ones, by batch
    missing: list[int]  # batches whose rows the table still lacks; none beyond its end
    bad: dict[int, str]  # what is wrong with bad files, by batch; it is missing unless another file holds it too
    statuses: dict[str, int]  # number of rows of the table by status
    rows: int  # of the table


@dataclass
class PartIndex:
    """The sound parts of a plan and its bad files, collected during a survey."""

    parts: dict[int, Part] = field(default_factory=dict)  # to read each batch from
    bad: dict[int, str] = field(default_factory=dict)  # what is wrong with the bad files, by batch

    def add(self, parts: Iterable[Part]) -> None:
        """Add the parts of a file; of two parts of a batch, the one that `rank` puts first is kept."""
        for part in parts:
            other = self.parts.get(part.batch)
            if other is None or rank(part) < rank(other):
                self.parts[part.batch] = part


def rank(part: Part) -> tuple[int, int]:
    """Return a sort key for the files that hold a batch: its own file first, then longer merged files first."""
    # a rerun writes a part beside the merged file, so the part is the newer one
    return (0, 0) if part.merged is None else (1, part.merged[0] - part.merged[1])


def survey(files: Files, plan: PlanHeader, end: int, *, verify: bool) -> Survey:
    """Return which parts and rows of a plan a store holds; rows from ``end`` on do not count. See `Store.survey`."""
    index = _index_parts(files, plan, verify=verify)
    parts = dict(sorted(index.parts.items()))
    needed = range(plan.batches_before(end))
    statuses = total(_count_statuses(files, plan, parts[batch], end) for batch in needed if batch in parts)
    missing = [batch for batch in needed if batch not in parts]
    return Survey(parts, missing, dict(sorted(index.bad.items())), statuses, sum(statuses.values()))


def _index_parts(files: Files, plan: PlanHeader, *, verify: bool) -> PartIndex:
    """Return the sound and the bad files in a plan's folder of parts."""
    # If parts are merged while the folder is being listed, the listing may miss both the part and the merged file. So
    # if a batch is missing, the folder is listed a second time.
    recorded, index = load_manifest(files, plan), PartIndex()
    done: set[str] = set()
    for _ in range(2):
        sizes = files.sizes(folder(plan))
        if files.local:  # the listing of a shared folder may lag behind its files
            sizes |= _sizes_of_unlisted(files, plan, recorded.keys() - sizes.keys())
        to_read = []
        for name in sorted(sizes.keys() - done):
            # a listing has the size, but the hash takes reading the file: only ``verify`` finds damage that keeps it
            known = recorded.get(name) if batches_of(name, plan) else None
            if not verify and known and known[0].size == sizes[name]:
                index.add(known)
            else:
                to_read.append(name)
        _check_files(files, plan, to_read, index)
        done |= sizes.keys()
        if len(index.parts) == len(plan.batches):
            break
    return index


def _sizes_of_unlisted(files: Files, plan: PlanHeader, names: Iterable[str]) -> dict[str, int]:
    """Return the sizes of the files that exist although the listing lacks them."""
    sizes = {}
    for name in names:
        try:
            sizes[name] = files.size(f"{folder(plan)}/{name}")
        except FileNotFoundError:
            continue
    return sizes


def _check_files(files: Files, plan: PlanHeader, names: list[str], index: PartIndex) -> None:
    """Read files and add them to the index."""

    def check_one(files: Files, name: str) -> list[Part] | str:
        try:
            return check_file(files, plan, name)
        except FileNotFoundError:  # merged or quarantined since the listing
            return []
        except BadPart as error:
            return f"{name} {error}"

    files_of_rows = [name for name in names if batches_of(name, plan)]
    for name, tried in read_several(files, files_of_rows, check_one):
        result = check_one(files, name) if tried is None else tried
        if isinstance(result, str):
            first, last = batches_of(name, plan) or (0, -1)
            index.bad.update(dict.fromkeys(range(first, last + 1), result))
        else:
            index.add(result)


def _count_statuses(files: Files, plan: PlanHeader, part: Part, end: int) -> dict[str, int]:
    """Return the number of rows of a part before row ``end``, by status."""
    first, count = plan.batches[part.batch]
    if first + count <= end:
        return part.statuses
    # the table ends within this batch, where the stopping rule ended the campaign, and a seal counts whole batches
    table = read_file(files, plan, part.file, ["status"])
    begin = plan.batches[part.merged[0] if part.merged else part.batch][0]
    statuses = table["status"].slice(first - begin, end - first).to_pylist()
    return {status: statuses.count(status) for status in set(statuses)}
