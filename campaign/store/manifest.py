"""The manifest: the parts as last checked, so that they need not be read again.

It only saves time: a file that it does not list, or lists with another size, is read. Each of its segments, a file of
its own, lists the parts of 2,000 batches, so that what a coordinator writes every half minute is what has changed
since, and not all that there is. Earlier versions wrote one file for all batches, which is read as the first segment.
"""

import hashlib
import json
import logging
import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from typing import Any

from campaign.errors import StoreError
from campaign.plan_header import PlanHeader
from campaign.store.files.files import Files
from campaign.store.files.several import content, read_several
from campaign.store.layout import manifest_name
from campaign.store.parts import Part, batches_of

FORMAT = 1
SEGMENT = 2000  # batches: 0.3 MB

logger = logging.getLogger(__name__)


def segment_of(batch: int) -> int:
    """Return the number of the segment that lists the part of a batch."""
    return batch // SEGMENT


def batches_in(segments: Iterable[int]) -> Iterator[int]:
    """Yield the numbers of the batches that some segments are for, of the last one also numbers of no batch."""
    for segment in segments:
        yield from range(segment * SEGMENT, (segment + 1) * SEGMENT)


def record_parts(
    files: Files, plan: PlanHeader, parts: Iterable[Part], segments: Collection[int] | None = None
) -> None:
    """Write segments, each whole or not at all: some, of which these are all parts, or None: all, and all parts."""
    listed = defaultdict[int, list[Part]](list)
    for part in parts:
        listed[segment_of(part.batch)].append(part)
    written = sorted(listed.keys() | {0} if segments is None else segments)
    for segment in written:
        files.write(manifest_name(plan, segment), _dump(plan, listed[segment]))
    if segments is None:
        # they would vouch for files that come back with the old size and other rows
        for segment in _segments(files, plan).difference(written):
            files.remove(manifest_name(plan, segment))


def load_manifest(files: Files, plan: PlanHeader) -> dict[str, list[Part]]:
    """Return the parts that the manifest lists, by file; a segment that cannot be used is left out, with a warning."""
    there = _segments(files, plan)
    names = {manifest_name(plan, segment): segment for segment in sorted(there)}
    by_file = defaultdict[str, list[Part]](list)
    for name, tried in read_several(files, list(names), content):
        try:
            parts = _parse(plan, content(files, name) if tried is None else tried)
        except (ValueError, StoreError, RecursionError) as error:  # RecursionError: JSON nested too deeply
            logger.warning("%s is not valid, so its parts are read instead: %s", name, error)
            continue
        for file, part in parts:
            segment = segment_of(part.batch)
            if names[name] == (segment if segment in there else 0):
                by_file[file].append(part)
    return {file: parts for file, parts in by_file.items() if _is_whole(parts)}


def _segments(files: Files, plan: PlanHeader) -> set[int]:
    """Return the numbers of the segments that a store may hold: the first, and those that it lists."""
    last = segment_of(len(plan.batches) - 1)
    names = set(files.names(plan.campaign_id)) if last else ()
    return {0} | {n for n in range(1, last + 1) if manifest_name(plan, n).rpartition("/")[2] in names}


def _is_whole(parts: list[Part]) -> bool:
    """Return whether parts are all those in their file, as one reading of it found them."""
    if parts[0].merged is None:
        return True
    # one merged file may be in two segments, and in one of them as it was before
    first, last = parts[0].merged
    same_file = len({(part.size, part.sha256) for part in parts}) == 1
    return same_file and {part.batch for part in parts} == set(range(first, last + 1))


def _dump(plan: PlanHeader, parts: Iterable[Part]) -> bytes:
    """Return the content of a segment."""
    files: dict[str, Any] = {}
    for part in parts:
        entry = files.setdefault(part.file, {"size": part.size, "sha256": part.sha256, "statuses": {}})
        entry["statuses"][str(part.batch)] = part.statuses
    listed = _canonical(files)
    head = json.dumps({"format": FORMAT, "campaign": plan.sealed_as, "digest": _digest(listed)}, separators=(",", ":"))
    return f'{head[:-1]},"files":{listed}}}\n'.encode()


def _parse(plan: PlanHeader, text: bytes) -> list[tuple[str, Part]]:
    """Return files and parts that a segment lists, none if empty; ValueError if it is another plan's, or changed."""
    if not text:
        return []
    document = json.loads(text)
    try:
        if (document["format"], document["campaign"]) != (FORMAT, plan.sealed_as):
            raise ValueError("it belongs to another campaign or has another format")
        if document["digest"] != _digest(_canonical(document["files"])):
            raise ValueError("its content was changed after it was written")
        files = document["files"].items()
        return [(name, part) for name, entry in files for part in _listed_parts(plan, name, entry)]
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"its content is not that of a manifest ({error!r})") from error


def _listed_parts(plan: PlanHeader, name: str, entry: dict[str, Any]) -> Iterator[Part]:
    """Yield the parts in a file that its entry lists."""
    span = batches_of(name, plan)
    size, sha256 = int(entry["size"]), str(entry["sha256"])
    if span is None or size <= 0 or not re.fullmatch("[0-9a-f]{64}", sha256):
        raise ValueError(f"it lists a file that cannot be a file of rows: {name[:60]!r}")
    merged = span if name.startswith("rows") else None
    for key, statuses in entry["statuses"].items():
        batch, rows = int(key), sum(statuses.values())
        if not span[0] <= batch <= span[1] or rows != plan.batches[batch][1]:
            raise ValueError(f"its number of rows of batch {batch} differs from the plan")
        yield Part(batch, rows, statuses, size, sha256, merged)


def _canonical(files: dict[str, Any]) -> str:
    return json.dumps(files, sort_keys=True, separators=(",", ":"))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
