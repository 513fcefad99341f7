"""The table of samples as checked arrays: the only place that knows its columns."""

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from reporting.errors import ReportError
from reporting.spec import ReportSpec

if TYPE_CHECKING:
    import pyarrow

CERTIFICATE = ("sample", "status", "message", "max_residual", "max_penetration", "settled")
OK = "ok"


@dataclass(frozen=True)
class Samples:
    """One row per sample, as arrays.

    Attributes
    ----------
    sample : array of int64, shape (n,)
    status, message : array of str, shape (n,)
    ok : array of bool, shape (n,)
        Where `status` is "ok".
    values : dict of str to array of float64, shape (n,)
        Variables and responses by name, NaN where the table holds none; a response counts only where `ok`.
    max_residual, max_penetration : array of float64, shape (n,)
    settled : array of bool, shape (n,)
    penetration_unit : str
        From the column's metadata; empty where there is none.
    """

    sample: NDArray[np.int64]
    status: NDArray[np.str_]
    message: NDArray[np.str_]
    ok: NDArray[np.bool_]
    values: dict[str, NDArray[np.float64]]
    max_residual: NDArray[np.float64]
    max_penetration: NDArray[np.float64]
    settled: NDArray[np.bool_]
    penetration_unit: str


def read_samples(table: "pyarrow.Table", spec: ReportSpec) -> Samples:
    """Check the table against the spec and return its columns, in the order of the samples.

    Raises
    ------
    ReportError
        A column is missing, double, or of the wrong kind; a sample number or status is missing; a sample
        appears twice; more rows than samples asked for.
    """
    _check_columns(table, spec)
    table = table.sort_by("sample")
    sample = _numbers(table, "sample").astype(np.int64)
    _check_rows(sample, spec.requested)
    status = _strings(table, "status")
    if "" in status:
        raise ReportError(f"sample {sample[int(np.argmax(status == ''))]} has no status; repair or recompute its batch")
    ok = status == OK
    values = {variable.name: _numbers(table, variable.name) for variable in spec.variables}
    for response in spec.responses:
        values[response.name] = _numbers(table, response.name)
    return Samples(
        sample=sample,
        status=status,
        message=_strings(table, "message"),
        ok=ok,
        values=values,
        max_residual=_numbers(table, "max_residual"),
        max_penetration=_numbers(table, "max_penetration"),
        settled=_numbers(table, "settled") == 1.0,
        penetration_unit=_unit(table, "max_penetration"),
    )


def _check_columns(table: "pyarrow.Table", spec: ReportSpec) -> None:
    """Raise ReportError unless every column the report reads is there once."""
    names = [variable.name for variable in spec.variables] + [response.name for response in spec.responses]
    repeated = [name for name, count in Counter([*names, *CERTIFICATE]).items() if count > 1]
    if repeated:
        raise ReportError(f"{repeated[0]!r} names more than one variable, response or column of the certificate")
    present = Counter(table.column_names)
    for name in (*CERTIFICATE, *names):
        if present[name] != 1:
            what = "is missing from" if present[name] == 0 else f"appears {present[name]} times in"
            raise ReportError(
                f"column {name!r} {what} the table of samples, which has "
                f"{', '.join(table.column_names) or 'none'}; give the table of the campaign the report is for"
            )


def _check_rows(sample: NDArray[np.int64], requested: int) -> None:
    """Raise ReportError for repeated samples or more rows than were asked for."""
    if requested < 1:
        raise ReportError(f"requested = {requested}: a campaign asks for at least 1 sample")
    repeated = sample[1:][np.diff(sample) == 0]
    if repeated.size:
        raise ReportError(f"sample {repeated[0]} appears more than once; every sample may have one row")
    if sample.size > requested:
        raise ReportError(f"the table has {sample.size} rows, the campaign asked for {requested}; extend the campaign")


def _numbers(table: "pyarrow.Table", name: str) -> NDArray[np.float64]:
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
    values: NDArray[np.float64] = column.cast(pyarrow.float64()).to_numpy()
    return values


def _strings(table: "pyarrow.Table", name: str) -> NDArray[np.str_]:
    """Return a column as text, nulls as the empty text."""
    import pyarrow

    column = table.column(name)
    kind = column.type
    if pyarrow.types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if not (pyarrow.types.is_string(kind) or pyarrow.types.is_large_string(kind) or pyarrow.types.is_null(kind)):
        raise ReportError(f"column {name!r} holds {kind}; text is needed")
    return np.array([text or "" for text in column.to_pylist()], dtype=np.str_)


def _unit(table: "pyarrow.Table", name: str) -> str:
    """Return the unit in a column's metadata, or the empty text."""
    metadata: dict[bytes, bytes] = table.schema.field(name).metadata or {}
    return metadata.get(b"unit", b"").decode()
