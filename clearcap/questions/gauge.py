"""A gauge study from a table of measurements: repeatability and reproducibility, and bias against reference values."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from campaign.errors import SpecError
from clearcap.questions.measured import column_of, numbers_of, read_parts, without_empty_rows
from reporting import ReportError
from reporting.gauge import BiasStudy, GaugeStudy, gauge_bias, gauge_repeatability

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Gauge:
    """What a table of measurements says of the measuring system."""

    repeatability: GaugeStudy | None  # None if no part is measured more than once
    bias: BiasStudy | None  # None without reference values


def gauge_study(
    table: "str | Path | pd.DataFrame",
    value: str = "value",
    part: str = "part",
    operator: str = "operator",
    reference: str = "reference",
    *,
    nested: bool = False,
    tolerance: float | None = None,
    confidence: float = 0.95,
) -> Gauge:
    """Return repeatability, reproducibility, bias and linearity of a measuring system.

    Parameters
    ----------
    table : str, Path or pandas.DataFrame
        One row a measurement: a CSV, Parquet or Excel file, or a table. Rows without a value are left out.
    value, part, operator, reference : str
        Names of the columns: the measurement, its part, who measured, and the part's reference value. A table without
        the column of operators has one operator; without that of reference values there is no bias; with reference
        values the column of parts may be missing.
    nested : bool
        Whether each operator has parts of their own, as where a test destroys them.
    tolerance : float or None
        Distance between the limits of the characteristic, in the unit of the values.
    confidence : float
        Of the intervals.

    Returns
    -------
    Gauge
        ``repeatability`` and ``bias``, None where the table has no columns for them.

    Raises
    ------
    SpecError
        The table does not fit the study.
    """
    where = f"table {table}" if isinstance(table, str | Path) else "table"
    try:
        rows = without_empty_rows(read_parts(table) if isinstance(table, str | Path) else table)
        there = [str(column) for column in rows.columns]
        x = numbers_of(column_of(rows, value, "value"), value)
        rows, x = rows[x == x], x[x == x]
        known = numbers_of(column_of(rows, reference, "reference"), reference) if reference in there else None
        bias = None if known is None else gauge_bias(x, known, confidence=confidence)
        if known is not None and part not in there:
            return Gauge(None, bias)
        parts = column_of(rows, part, "part").astype(str).to_numpy(object)
        by = column_of(rows, operator, "operator").astype(str).to_numpy(object) if operator in there else None
        found = gauge_repeatability(x, parts, by, nested=nested, tolerance=tolerance, confidence=confidence)
    except (ReportError, SpecError) as error:
        raise SpecError(str(error) if str(error).startswith("parts ") else f"{where}: {error}") from error
    return Gauge(found, bias)
