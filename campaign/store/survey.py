"""What a store holds of a plan: a listing, the manifest, and a look into the files that the manifest does not know."""

import logging
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from campaign.errors import StoreError
from campaign.plan_header import PlanHeader
from campaign.store import manifest
from campaign.store.files.files import LARGEST, Files
from campaign.store.layout import MANIFEST
from campaign.store.parts import BadPart, Part, batches_of, check, decode, folder, total

if TYPE_CHECKING:
    import pyarrow as pa

READERS = 8  # files read at a time
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Survey:
    """What a store holds of a plan.

    Attributes
    ----------
    parts : dict of int to Part
        Sound parts, by batch.
    missing : list of int
        Batches whose rows the table still lacks; none beyond its end.
    bad : dict of int to str
        Batches of files that are not sound, and what is wrong with them. Such a batch is missing, unless another
        file holds it too.
    statuses : dict of str to int
        How many rows of the table there are in which status.
    rows : int
        How many rows of the table there are.
    """

    parts: dict[int, Part]
    missing: list[int]
    bad: dict[int, str]
    statuses: dict[str, int]
    rows: int


@dataclass
class Holdings:
    """The sound files of a plan and what is wrong with the others, while a survey goes on."""

    parts: dict[int, Part] = field(default_factory=dict)
    bad: dict[int, str] = field(default_factory=dict)

    def add(self, parts: Iterable[Part]) -> None:
        """Add the parts of a file; a batch's own file comes before a merged one, a longer one before a shorter."""
        for part in parts:
            known = self.parts.get(part.batch)
            if known is None or rank(part) < rank(known):
                self.parts[part.batch] = part


def rank(part: Part) -> tuple[int, int]:
    """Return a key by which the file to read a batch from comes first."""
    return (0, 0) if part.merged is None else (1, part.merged[0] - part.merged[1])


def load_manifest(files: Files, plan: PlanHeader) -> dict[str, list[Part]]:
    """Return what the manifest knows by file; nothing if there is none that can be used, and say so."""
    name = f"{plan.campaign_id}/{MANIFEST}"
    try:
        return manifest.load(plan, files.read(name))
    except FileNotFoundError:
        return {}
    except (ValueError, StoreError, RecursionError) as error:
        logger.warning("%s cannot be used, so all parts are read: %s", name, error)
        return {}


def holdings(files: Files, plan: PlanHeader, *, verify: bool) -> Holdings:
    """Return what a plan's folder of parts holds.

    A folder is not listed in an instant: what is merged meanwhile may be in neither place. So if a batch is not
    found, it is listed once more.
    """
    known, found = load_manifest(files, plan), Holdings()
    looked: set[str] = set()
    for _ in range(2):
        sizes = files.sizes(folder(plan))
        if files.local:  # a shared folder's listing may lag behind what is there
            sizes |= _unlisted(files, plan, known.keys() - sizes.keys())
        unread = []
        for name in sorted(sizes.keys() - looked):
            if not verify and _unchanged(plan, name, known.get(name), sizes[name]):
                found.add(known[name])
            else:
                unread.append(name)
        _check(files, plan, unread, found)
        looked |= sizes.keys()
        if len(found.parts) == len(plan.batches):
            break
    return found


def _unlisted(files: Files, plan: PlanHeader, names: Iterable[str]) -> dict[str, int]:
    sizes = {}
    for name in names:
        try:
            sizes[name] = files.size(f"{folder(plan)}/{name}")
        except FileNotFoundError:
            continue
    return sizes


def _unchanged(plan: PlanHeader, name: str, known: list[Part] | None, size: int) -> bool:
    """Return whether a file is, by its size, still the one that the manifest knows."""
    span = batches_of(name, plan)
    return span is not None and known is not None and known[0].size == size


def _check(files: Files, plan: PlanHeader, names: list[str], found: Holdings) -> None:
    """Add files to what was found that must be checked, some at a time: an object store answers slowly."""

    def look(name: str) -> list[Part] | str:
        try:
            return check_file(files, plan, name)
        except FileNotFoundError:  # merged or quarantined since it was listed
            return []
        except BadPart as error:
            return f"{name} {error}"

    rows = [name for name in names if batches_of(name, plan)]
    with ThreadPoolExecutor(READERS) as pool:
        for name, result in zip(rows, pool.map(look, rows), strict=True):
            if isinstance(result, str):
                first, last = batches_of(name, plan) or (0, -1)
                found.bad.update(dict.fromkeys(range(first, last + 1), result))
            else:
                found.add(result)


def check_file(files: Files, plan: PlanHeader, name: str) -> list[Part]:
    """Return what is to be known of the batches of a file of rows.

    Raises
    ------
    FileNotFoundError
        If it is not there.
    BadPart
        If it is truncated, damaged, too large, or from elsewhere.
    """
    return _checked(files, plan, name)[1]


def read_file(files: Files, plan: PlanHeader, name: str, columns: Sequence[str] | None = None) -> "pa.Table":
    """Return the rows of a file, of all columns or these; errors as in `check_file`."""
    return decode(plan, _checked(files, plan, name)[0], columns)


def _checked(files: Files, plan: PlanHeader, name: str) -> tuple[bytes, list[Part]]:
    """Return the content of a file of rows, and what is to be known of its batches."""
    span = batches_of(name, plan)
    if span is None:
        raise FileNotFoundError(name)
    content = _content(files, plan, name)
    return content, check(plan, content, *span, merged=name.startswith("rows"))


def _content(files: Files, plan: PlanHeader, name: str) -> bytes:
    path = f"{folder(plan)}/{name}"
    size = files.size(path)
    if size > LARGEST:
        raise BadPart(f"has {size} bytes, more than any file of rows")
    return files.read(path)


def survey(files: Files, plan: PlanHeader, end: int, *, verify: bool) -> Survey:
    """Return what a store holds of a plan whose table ends at sample ``end``."""
    found = holdings(files, plan, verify=verify)
    parts = dict(sorted(found.parts.items()))
    needed = [batch for batch, (first, _) in enumerate(plan.batches) if first < end]
    there = [parts[batch] for batch in needed if batch in parts]
    statuses = total(_counted(files, plan, part, end) for part in there)
    missing = [batch for batch in needed if batch not in parts]
    return Survey(parts, missing, dict(sorted(found.bad.items())), statuses, sum(statuses.values()))


def _counted(files: Files, plan: PlanHeader, part: Part, end: int) -> dict[str, int]:
    """Return the statuses of a part's rows before ``end``."""
    first, count = plan.batches[part.batch]
    if first + count <= end:
        return part.statuses
    table = read_file(files, plan, part.file, ["status"])
    begin = plan.batches[part.merged[0] if part.merged else part.batch][0]
    statuses = table["status"].slice(first - begin, end - first).to_pylist()
    return {status: statuses.count(status) for status in set(statuses)}
