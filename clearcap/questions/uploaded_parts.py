"""Measured parts that were sent to a store: their table and limits become the report of `clearcap capability` there."""

import json
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from campaign.store import open_store
from campaign.store.files.retry_policy import QUICK
from campaign.store.measured_library import MeasuredParts, id_of_parts, read_parts_record, save_parts
from clearcap.questions.measured import capability_report
from clearcap.questions.measurement_table import LARGEST_TABLE
from clearcap.questions.report_source import sha256
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST
from reporting.write import NAMES

KINDS = ("html", "json", "parquet", "xlsx", "summary")
LIMITS = "limits.toml"
_LONGEST_NAME = 50  # characters, of up to 4 bytes each


def report_into_store(store: str, table: Path, file: str, limits: Path, by: str) -> dict[str, Any]:
    """Save a table, its limits and their report in a store; return its record, and whether it ``is_new``.

    `file` is the table's name where it came from. The same table with the same limits is there once. Nothing is saved
    if they do not fit. For a process of its own: the current folder is another meanwhile.
    """
    opened, name = open_store(store, QUICK), file_name(file)
    content, of_limits = read_regular_file(table, LARGEST_TABLE), read_regular_file(limits, LARGEST)
    digests = sha256(content), sha256(of_limits)
    known = id_of_parts(name, *digests)
    if (found := read_parts_record(opened, known)) is not None:
        return {"parts": found.model_dump(), "is_new": False}
    with own_folder(table, name, limits):
        written = capability_report(name, LIMITS, "report", KINDS)
        files = {Path(path).name: Path(path).read_bytes() for path in written.values()}
    document = json.loads(files[NAMES["json"]])
    verdicts = {
        r["spec"]["name"]: r["verdict"] + (", not certain" if r["certain"] is False else "")
        for r in document["responses"]
    }
    made = MeasuredParts(
        id=known,
        file=name,
        table=digests[0],
        limits=digests[1],
        title=document["title"],
        parts=document["finished"],
        headline=document["headline"],
        verdicts=verdicts,
        by=by,
        at=time.time(),
    )
    sources = {f"table{Path(name).suffix.lower()}": content, LIMITS: of_limits}
    saved = save_parts(opened, made, files | sources)
    return {"parts": saved.model_dump(), "is_new": saved == made}


@contextmanager
def own_folder(table: Path, file: str, limits: Path | None) -> Iterator[tuple[str, str | None]]:
    """Have a table and its limits in a current folder of their own, which no text then names; yield their names."""
    name = file_name(file)
    with TemporaryDirectory(prefix="clearcap-") as folder, chdir(folder):
        shutil.copyfile(table, name)
        if limits is not None:
            shutil.copyfile(limits, LIMITS)
        yield name, None if limits is None else LIMITS


def file_name(name: str) -> str:
    """Return a name as a file here may have it, with the ending of the one that was sent."""
    stem, dot, ending = re.sub(r"[^\w .()+-]", "_", name).strip(" .").rpartition(".")
    return (
        f"{stem[:_LONGEST_NAME].lstrip(' .-') or 'parts'}{dot}{ending[:10]}"
        if dot
        else (ending[:_LONGEST_NAME] or "parts")
    )
