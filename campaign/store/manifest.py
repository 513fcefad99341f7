"""``manifest.json``: the parts as last checked, so that they need not be read again.

The manifest only saves time. A file that it does not list, or lists with another size, is read.
"""

import hashlib
import json
import re
from collections.abc import Iterable
from typing import Any

from campaign.plan_header import PlanHeader
from campaign.store.parts import Part, batches_of

FORMAT = 1


def dump(plan: PlanHeader, parts: Iterable[Part]) -> bytes:
    """Return the content of a manifest."""
    files: dict[str, Any] = {}
    for part in sorted(parts, key=lambda part: part.batch):
        entry = files.setdefault(part.file, {"size": part.size, "sha256": part.sha256, "statuses": {}})
        entry["statuses"][str(part.batch)] = part.statuses
    document = {"format": FORMAT, "campaign": plan.sealed_as, "digest": _digest(files), "files": files}
    return (json.dumps(document, separators=(",", ":")) + "\n").encode()


def load(plan: PlanHeader, content: bytes) -> dict[str, list[Part]]:
    """Return the parts that a manifest names, by file.

    Raises ValueError if the content is not a manifest of this plan, or was changed after it was written.
    """
    document = json.loads(content)
    try:
        if (document["format"], document["campaign"]) != (FORMAT, plan.sealed_as):
            raise ValueError("it belongs to another campaign or has another format")
        if document["digest"] != _digest(document["files"]):
            raise ValueError("its content was changed after it was written")
        files = {name: _parts(plan, name, entry) for name, entry in document["files"].items()}
        return {name: parts for name, parts in files.items() if parts}
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"its content is not that of a manifest ({error!r})") from error


def _parts(plan: PlanHeader, name: str, entry: dict[str, Any]) -> list[Part]:
    """Return the parts in a file, as its entry lists them; empty if the entry does not list all of them."""
    span = batches_of(name, plan)
    size, sha256 = int(entry["size"]), str(entry["sha256"])
    if span is None or size <= 0 or not re.fullmatch("[0-9a-f]{64}", sha256):
        raise ValueError(f"it lists a file that cannot be a file of rows: {name[:60]!r}")
    merged = span if name.startswith("rows") else None
    parts = []
    for key, statuses in entry["statuses"].items():
        batch, rows = int(key), sum(statuses.values())
        if not span[0] <= batch <= span[1] or rows != plan.batches[batch][1]:
            raise ValueError(f"its number of rows of batch {batch} differs from the plan")
        parts.append(Part(batch, rows, statuses, size, sha256, merged))
    return parts if len(parts) == span[1] - span[0] + 1 else []


def _digest(files: dict[str, Any]) -> str:
    """Return a digest of the entries of a manifest."""
    return hashlib.sha256(json.dumps(files, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
