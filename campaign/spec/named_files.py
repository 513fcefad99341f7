"""The files that a campaign names, of a folder or given with its text, and the columns of its data files.

And the names of the campaigns that are shipped.
"""

import csv
import io
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path, PurePath
from signal import SIGXCPU
from typing import Any, Protocol, TypeGuard

import numpy as np

from campaign.errors import SpecError
from campaign.spec.faults import SpecFault, fault
from engine import load_mechanism, load_mechanism_text
from engine.arrays import Array
from engine.mechanism import Mechanism, library_names
from engine.mechanism.faults import did_you_mean
from engine.platform.child import Child, ChildEnded, ChildRaised, Limits, python_environment
from engine.platform.regular_file import UnfitFile, read_regular_file
from engine.preflight.cautions import with_start_gaps

MOST_FILES = 100  # given with a campaign's text
LARGEST_TOTAL = 200_000_000  # bytes of all given files
LONGEST_NAME = 200  # characters
_RELATIVE = r"(?!.*(?:^|/)\.{0,2}(?:/|$))[^\\:]+"  # no part may be empty, . or ..; no drive letter
LARGEST_FILE = 100_000_000  # bytes
LONGEST_HEADER = 100_000  # bytes of a CSV file's first line
LARGEST_DECODED = 1 << 30  # bytes that decoding a Parquet file may take
LONGEST_READ = 60.0  # s of processor time for a Parquet file
FORMATS = (".csv", ".parquet")
PLAIN_MEMORY = {"ARROW_DEFAULT_MEMORY_POOL": "system"}  # other pools reserve more than they use, which counts


def campaign_names() -> list[str]:
    """Return the names of the shipped campaigns."""
    folder = resources.files("campaign").joinpath("library")
    return sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml"))


class NamedFiles(Protocol):
    """Access to the files that a campaign names."""

    def mechanism(self, name: str) -> Mechanism:
        """Return the mechanism of this name; MechanismError or SpecError if it does not exist or has faults."""

    def content(self, name: str, at_most: int) -> bytes:
        """Return the content of a data file of at most ``at_most`` bytes; SpecError, without the key, on failure."""

    def may_quote(self, name: str) -> bool:
        """Return whether a message may quote the content of a data file."""


@dataclass(frozen=True)
class FolderFiles:
    """Files by path, relative to a folder: all files that the user of this process may read."""

    folder: Path
    inline: Mechanism | None = None  # built in code, instead of a file

    def mechanism(self, name: str) -> Mechanism:
        """Return a shipped mechanism or one from a file; MechanismError if it does not exist or has faults."""
        if self.inline is not None:
            return self.inline
        is_path = Path(name).suffix == ".toml" or len(Path(name).parts) > 1
        return with_start_gaps(load_mechanism(self.folder / name if is_path else name))

    def content(self, name: str, at_most: int) -> bytes:
        """Return the content of a regular file; SpecError if it does not exist or cannot be read."""
        path = self.folder / name
        try:
            return read_regular_file(path, at_most)
        except (FileNotFoundError, ValueError) as error:  # ValueError: a NUL in the name
            what = path if isinstance(error, OSError) else error
            raise SpecError(f"no such file ({what}); paths are relative to the campaign file") from error
        except UnfitFile as error:
            most = f"files of up to {at_most // 1_000_000} MB; keep only the columns and rows that the campaign needs"
            raise SpecError(f"cannot be read ({error.strerror}); allowed: {most}") from error
        except OSError as error:
            kind = path.suffix.lower()[1:]
            raise SpecError(f"cannot be read ({error.strerror or error}); name a readable {kind} file") from error

    def may_quote(self, name: str) -> bool:
        """Return whether a file lies in the folder; others are not quoted, as a campaign may name any file."""
        try:
            return (self.folder / name).resolve().is_relative_to(self.folder.resolve())
        except (OSError, ValueError, RuntimeError):  # a loop of links, a NUL in the name
            return False


class GivenFiles:
    """Files given with the text of a campaign, which cannot name any others, by names such as ``data/gaps.csv``."""

    def __init__(self, contents: Mapping[str, bytes]) -> None:
        total = sum(map(len, contents.values()))
        if len(contents) > MOST_FILES or total > LARGEST_TOTAL:
            raise SpecError(
                f"{len(contents)} files of {total} bytes are given with the campaign; allowed: {MOST_FILES} files and"
                f" {LARGEST_TOTAL} bytes in all; give only those that it names"
            )
        for name in contents:
            if len(name) > LONGEST_NAME or not name.isprintable() or not re.fullmatch(_RELATIVE, name):
                raise SpecError(
                    f"{name!a:.120}: not a usable name of a file given with a campaign; allowed: relative names such as"
                    f" latch.toml or data/gaps.csv, up to {LONGEST_NAME} characters, without .. and \\; rename it"
                )
        self._contents = dict(contents)

    def mechanism(self, name: str) -> Mechanism:
        """Return a shipped or a given mechanism; raises the same errors as `NamedFiles`."""
        if name in library_names():
            return load_mechanism(name)
        return load_mechanism_text(self._given(name, f", and shipped mechanisms: {', '.join(library_names())}"), name)

    def content(self, name: str, at_most: int) -> bytes:
        """Return the content of a given file; SpecError if it was not given or is too large."""
        content = self._given(name)
        if len(content) > at_most:
            raise SpecError(
                f"has {len(content)} bytes; allowed: up to {at_most}; keep only the columns and rows that the campaign"
                " needs"
            )
        return content

    def may_quote(self, name: str) -> bool:
        """Return True: the sender of a file may see its content quoted."""
        return True

    def _given(self, name: str, others: str = "") -> bytes:
        """Return the content of a file; if it was not given, SpecError lists the given ones."""
        content = self._contents.get(name.removeprefix("./"))
        if content is None:
            names = f": {', '.join(self._contents)}" if self._contents else "; no file was given"
            raise SpecError(
                f"no such file is given with the campaign; allowed: those that are{names}{others}; give it too, or name"
                f" another{did_you_mean(name, [*self._contents, *(library_names() if others else ())])}"
            )
        return content


# -- data files --------------------------------------------------------------------------------------------------------
#
# Their values become part of the campaign when it is loaded. A CSV file takes memory in proportion to its size. A
# Parquet file may take any, and may crash its reader, which is therefore a child process.


def read_data_files(raw: Mapping[str, Any], files: NamedFiles) -> tuple[dict[str, Any], list[SpecFault]]:
    """Return a campaign, as read, with the columns of its data files in place of their names, and the files' faults."""
    whole, faults = dict(raw), list[SpecFault]()
    variables, table = raw.get("variables"), raw.get("table")
    with ParquetReader() as reader:
        if isinstance(variables, dict):
            whole["variables"] = dict(variables)
            for name, entry in variables.items():
                if not _names_file(entry, "values") or not isinstance(entry.get("column"), str):
                    continue
                try:
                    values = read_columns(files, entry["file"], [entry["column"]], reader)[entry["column"]]
                    rest = {key: value for key, value in entry.items() if key not in ("file", "column")}
                    origin = f"{entry['file']}, column {entry['column']}"
                    whole["variables"][name] = {"source": origin, **rest, "values": values}
                except SpecError as error:
                    faults.append(fault(["variables", name, "file"], entry["file"], str(error)))
        if _names_file(table, "columns") and isinstance(variables, dict):
            try:
                columns = read_columns(files, table["file"], list(variables), reader)
                rest = {key: value for key, value in table.items() if key != "file"}
                whole["table"] = {"source": table["file"], **rest, "columns": columns}
            except SpecError as error:
                faults.append(fault(["table", "file"], table["file"], str(error)))
    return whole, faults


def read_columns(
    files: NamedFiles, file: str, names: list[str], reader: "ParquetReader | None" = None
) -> dict[str, list[float]]:
    """Return columns of finite numbers from a CSV or Parquet file, by name; SpecError, without the key, on failure."""
    suffix = PurePath(file).suffix.lower()
    if suffix not in FORMATS:
        raise SpecError("its name ends neither in .csv nor in .parquet; name a CSV or Parquet file")
    content, quote = files.content(file, LARGEST_FILE), files.may_quote(file)
    if suffix == ".csv":
        columns = _csv_columns(content, names, quote)
    elif reader is None:
        with ParquetReader() as own:
            columns = own.columns(content, names, quote)
    else:
        columns = reader.columns(content, names, quote)
    return {name: _finite(values, name) for name, values in columns.items()}


def _names_file(entry: Any, content: str) -> TypeGuard[dict[str, Any]]:
    """Return whether a table names a file instead of having its content under the key ``content``."""
    return (
        isinstance(entry, dict) and isinstance(entry.get("file"), str) and entry["file"] != "" and content not in entry
    )


def _check_names(names: Iterable[str], there: list[str], quote: bool) -> None:
    """Refuse a file unless it has exactly one column of each name."""
    for name in names:
        if (count := there.count(name)) != 1:
            what = f"no column {name}" if count == 0 else f"{count} columns {name}"
            some = ", ".join(f"{column:.40}" for column in there[:20]) + (", ..." if len(there) > 20 else "")
            columns = f"columns: {some}{did_you_mean(name, there[:1000])}" if quote else f"it has {len(there)} others"
            raise SpecError(f"{what}; {columns}")


def _reason(said: str) -> str:
    """Return pyarrow's reason in one line, without the row that it quotes, as a campaign may name any file."""
    return re.sub(r"(, got \d+|invalid value).*", r"\1", next(iter(said.splitlines()), "unknown"))[:200]


def _finite(values: Array, name: str) -> list[float]:
    """Return the values of a column, after checking that there are some and that all are finite."""
    wrong = np.flatnonzero(~np.isfinite(values))
    if values.size == 0:
        raise SpecError(f"column {name} is empty; it must hold at least one number")
    if wrong.size:
        raise SpecError(
            f"column {name}, row {wrong[0] + 1} of {values.size}: not finite, nor in {wrong.size - 1} other rows;"
            " complete or remove these rows"
        )
    numbers: list[float] = values.tolist()
    return numbers


def _csv_columns(content: bytes, names: list[str], quote: bool) -> dict[str, Array]:
    import pyarrow as pa
    from pyarrow import csv as arrow

    from campaign.spec.parquet_columns import MOST_COLUMNS, MOST_ROWS, check_size, check_type

    start = content[:LONGEST_HEADER]
    if len(content) > LONGEST_HEADER and b"\n" not in start and b"\r" not in start:
        raise SpecError(f"its first line has more than {LONGEST_HEADER} bytes; keep only the columns that you need")
    try:
        there = next(filter(None, csv.reader(io.StringIO(start.decode("utf-8-sig", "replace"), newline=""))), [])
    except csv.Error as error:
        raise SpecError(f"not csv: its first line cannot be read ({error}); correct the file") from error
    check_size(len(there), MOST_COLUMNS, "columns")
    # lines end with \n, \r\n or \r; one more than rows, for the header
    check_size(max(content.count(b"\n"), content.count(b"\r")), MOST_ROWS + 1, "lines")
    if there:  # otherwise pyarrow says what is wrong
        _check_names(names, there, quote)
    try:
        options = arrow.ConvertOptions(include_columns=names)
        table = arrow.read_csv(pa.BufferReader(content), convert_options=options)
    except (pa.ArrowException, OverflowError, ValueError) as error:
        raise SpecError(f"not csv: {_reason(str(error))}; correct the file") from error
    for name in names:
        check_type(name, table.schema.field(name).type)
    return {name: table.column(name).cast(pa.float64(), safe=False).to_numpy() for name in names}  # nulls become NaN


class ParquetReader:
    """A context with a child for Parquet files, started when the first one is read; see `parquet_columns`."""

    def __init__(self) -> None:
        self._child: Child | None = None

    def __enter__(self) -> "ParquetReader":
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    def columns(self, content: bytes, names: list[str], quote: bool) -> dict[str, Array]:
        """Return the named columns in the content of a Parquet file."""
        if self._child is None:
            self._child = Child(
                "campaign.spec.parquet_columns:read", {**python_environment(), **PLAIN_MEMORY}, quiet=True
            )
        request = json.dumps(names).encode() + b"\n" + content
        limits = Limits(LARGEST_DECODED + 3 * len(content), LONGEST_READ)
        there, columns = list[str](), list[Array]()
        try:
            for kind, sent in self._child.messages(request, limits, lambda _: 10.0 * LONGEST_READ):
                if kind == "names":
                    there = json.loads(sent)
                elif kind == "column":
                    columns.append(np.frombuffer(sent, np.float64))
        except ChildRaised as error:
            raise _refusal(error) from error
        except ChildEnded as error:
            self._end()
            is_slow = error.was_silent or error.status == -SIGXCPU
            what = f"it takes more than {LONGEST_READ:g} s to read" if is_slow else f"it crashes its reader ({error})"
            raise SpecError(f"not parquet: {what}; correct the file") from error
        _check_names(names, there, quote)
        return dict(zip(names, columns, strict=True))

    def _end(self) -> None:
        """End the child; the next file starts another."""
        if self._child is not None:
            self._child.close()
            self._child = None


def _refusal(error: ChildRaised) -> Exception:
    """Return the refusal of a Parquet file that cannot be read; the error itself if the file is not to blame."""
    if "SpecError" in error.kinds:
        return SpecError(error.message)
    if "MemoryError" in error.kinds:
        return SpecError("its content takes too much memory; keep only the columns and rows that you need")
    if {"ArrowException", "OSError", "ValueError", "OverflowError"} & set(error.kinds):
        return SpecError(f"not parquet: {_reason(error.message or error.kinds[0])}; correct the file")
    return error
