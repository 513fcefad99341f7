"""The rows of a campaign as checked arrays: the only place that knows their columns.

Rows come as one table or as a stream of tables, so that a million of them never stand in memory with their texts: of a
failure only the first messages of each status are kept.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.errors import ReportError
from reporting.spec import ReportSpec

if TYPE_CHECKING:
    from typing import TypeAlias

    import pyarrow

    Rows: TypeAlias = pyarrow.Table | Iterable[pyarrow.Table]

CERTIFICATE = ("sample", "status", "message", "max_residual", "max_penetration", "settled")
OPTIONAL = "wall_s"
OK = "ok"
MESSAGES_KEPT = 20  # of each status


@dataclass(frozen=True)
class Samples:
    """One row per sample, as arrays.

    Attributes
    ----------
    sample : array of int64, shape (n,)
    status : array of int16, shape (n,)
        Position in `statuses`.
    statuses : tuple of str
        Statuses that occur.
    messages : dict of int to str
        By sample number; of each status but "ok" the first 20.
    ok : array of bool, shape (n,)
        Where the status is "ok".
    values : dict of str to array of float64, shape (n,)
        Variables and responses by name, NaN where the table holds none; a response counts only where `ok`.
    max_residual, max_penetration : array of float64, shape (n,)
    settled : array of bool, shape (n,)
    penetration_unit : str
        From the column's metadata; empty where there is none.
    production_batch : array of int64, shape (n,), or None
        Number of each sample's production batch; None without production batches.
    run_seconds : float or None
        Time all runs took together [s]; None where the rows do not say it.
    """

    sample: NDArray[np.int64]
    status: NDArray[np.int16]
    statuses: tuple[str, ...]
    messages: dict[int, str]
    ok: NDArray[np.bool_]
    values: dict[str, Array]
    max_residual: Array
    max_penetration: Array
    settled: NDArray[np.bool_]
    penetration_unit: str
    production_batch: NDArray[np.int64] | None
    run_seconds: float | None

    def rows_of(self, status: str) -> NDArray[np.intp]:
        """Return the rows with a status."""
        if status not in self.statuses:
            return np.zeros(0, np.intp)
        return np.flatnonzero(self.status == self.statuses.index(status))


def read_samples(rows: "Rows", spec: ReportSpec) -> Samples:
    """Check the rows against the spec and return their columns, in the order of the samples.

    Parameters
    ----------
    rows : pyarrow.Table or iterable of pyarrow.Table
        One table in any order, or tables whose samples follow each other.
    spec : ReportSpec
        What was asked.

    Raises
    ------
    ReportError
        A column is missing, double, or of the wrong kind; a sample number or status is missing; a sample
        appears twice or out of order; more rows than samples asked for.
    """
    names = [*(v.name for v in spec.variables), *(r.name for r in spec.responses)]
    kept = [*names, "sample", "max_residual", "max_penetration", "settled"]
    kept += [spec.production_batch_column] if spec.production_batch_column else []
    pieces: dict[str, list[Array]] = {name: [np.zeros(0)] for name in kept}
    codes, statuses, messages = [np.zeros(0, np.int16)], dict[str, int](), dict[int, str]()
    unit, seconds = "", None
    for table in _tables(rows):
        _check_columns(table, spec, kept)
        unit = _unit(table, "max_penetration") or unit
        for name in kept:
            pieces[name].append(_numbers(table, name))
        codes.append(_statuses(table, statuses, messages))
        if OPTIONAL in table.column_names:
            seconds = (seconds or 0.0) + float(np.nansum(_numbers(table, OPTIONAL)))
    columns = {name: np.concatenate(pieces.pop(name)) for name in kept}
    sample, status = columns.pop("sample").astype(np.int64), np.concatenate(codes)
    _check_rows(sample, spec.requested)
    return Samples(
        sample=sample,
        status=status,
        statuses=tuple(statuses),
        messages=messages,
        ok=status == statuses.get(OK, -1),
        max_residual=columns.pop("max_residual"),
        max_penetration=columns.pop("max_penetration"),
        settled=columns.pop("settled") == 1.0,
        penetration_unit=unit,
        production_batch=columns.pop(spec.production_batch_column).astype(np.int64)
        if spec.production_batch_column
        else None,
        run_seconds=seconds,
        values=columns,
    )


def _tables(rows: "Rows") -> "Iterable[pyarrow.Table]":
    """Return the tables; a single one sorted."""
    import pyarrow

    if not isinstance(rows, pyarrow.Table):
        return rows
    return [rows.sort_by("sample") if rows.column_names.count("sample") == 1 else rows]


def _check_columns(table: "pyarrow.Table", spec: ReportSpec, kept: list[str]) -> None:
    """Raise ReportError unless every column the report reads is there once."""
    names = [variable.name for variable in spec.variables] + [response.name for response in spec.responses]
    repeated = [name for name, count in Counter([*names, *CERTIFICATE]).items() if count > 1]
    if repeated:
        raise ReportError(f"{repeated[0]!r} names more than one variable, response or column of the certificate")
    present = Counter(table.column_names)
    for name in dict.fromkeys((*CERTIFICATE, *kept)):
        if present[name] != 1:
            what = "is missing from" if present[name] == 0 else f"appears {present[name]} times in"
            raise ReportError(
                f"column {name!r} {what} the table of samples, which has "
                f"{', '.join(table.column_names) or 'none'}; give the table of the campaign the report is for"
            )


def _check_rows(sample: NDArray[np.int64], requested: int) -> None:
    """Raise ReportError for samples repeated or out of order, or more rows than were asked for."""
    if requested < 1:
        raise ReportError(f"requested = {requested}: a campaign asks for at least 1 sample")
    steps = np.diff(sample)
    if np.any(steps == 0):
        raise ReportError(f"sample {sample[int(np.argmin(steps != 0))]} appears more than once; give it one row")
    if np.any(steps < 0):
        at = int(np.argmax(steps < 0))
        raise ReportError(f"sample {sample[at + 1]} comes after {sample[at]}; give tables in the order of the samples")
    if sample.size > requested:
        raise ReportError(f"the table has {sample.size} rows, the campaign asked for {requested}; extend the campaign")


def _statuses(table: "pyarrow.Table", known: dict[str, int], messages: dict[int, str]) -> NDArray[np.int16]:
    """Return the rows' statuses as positions in `known`, which grows with them, as do the first messages of each."""
    import pyarrow

    words = _strings(table, "status")
    empty = words.null_count or pyarrow.compute.any(pyarrow.compute.equal(words, "")).as_py()
    if empty:
        at = next(i for i, word in enumerate(words.to_pylist()) if not word)
        raise ReportError(f"sample {table['sample'][at].as_py()} has no status; repair or recompute its batch")
    encoded = words.dictionary_encode().combine_chunks()
    encoded = encoded if isinstance(encoded, pyarrow.DictionaryArray) else encoded.chunk(0)
    translate = [known.setdefault(word, len(known)) for word in encoded.dictionary.to_pylist()]
    codes: NDArray[np.int16] = np.array([*translate, 0], np.int16)[
        encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64)
    ]
    told, sample = _strings(table, "message"), table["sample"]
    for word, code in known.items():
        # As many as may still be missing of this status: earlier tables may have given some.
        for row in np.flatnonzero(codes == code)[:MESSAGES_KEPT] if word != OK else ():
            messages[sample[int(row)].as_py()] = told[int(row)].as_py() or ""
    return codes


def _numbers(table: "pyarrow.Table", name: str) -> Array:
    """Return a column as floats, nulls as NaN."""
    import pyarrow

    column = table.column(name)
    kind = column.type
    if pyarrow.types.is_null(kind):  # a column of a table in which every run failed
        return np.full(len(column), np.nan)
    if not (pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind) or pyarrow.types.is_boolean(kind)):
        raise ReportError(f"column {name!r} holds {kind}; numbers are needed")
    if name == "sample" and column.null_count:
        raise ReportError(f"column 'sample' has {column.null_count} empty rows; every row needs its number")
    values: Array = column.cast(pyarrow.float64()).to_numpy()
    return values


def _strings(table: "pyarrow.Table", name: str) -> "pyarrow.ChunkedArray":
    """Return a column of text."""
    import pyarrow

    column = table.column(name)
    kind = column.type
    if pyarrow.types.is_dictionary(kind):
        kind = kind.value_type
    if not (pyarrow.types.is_string(kind) or pyarrow.types.is_large_string(kind) or pyarrow.types.is_null(kind)):
        raise ReportError(f"column {name!r} holds {kind}; text is needed")
    return column.cast(pyarrow.string())


def _unit(table: "pyarrow.Table", name: str) -> str:
    """Return the unit in a column's metadata, or the empty text."""
    metadata: dict[bytes, bytes] = table.schema.field(name).metadata or {}
    return metadata.get(b"unit", b"").decode()
