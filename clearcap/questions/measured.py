"""The capability of measured parts: a table of measurements and a file of limits become the same report as samples do.

The limits file is TOML: a title, a table for each characteristic with the keys of a campaign's response, and what the
table's other columns mean.
"""

import platform
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from campaign.errors import CampaignError, SpecError, unwritable
from campaign.plan import Plan
from campaign.row_build import clearcap_version
from campaign.spec.campaign_file import Response, ShortName
from campaign.spec.faults import SpecFault, structure_faults
from campaign.store import Store, open_store
from clearcap.questions.measurement_table import LARGEST_TABLE, labels_of, numbered, numbers_of, ranks_of, read_parts
from clearcap.questions.report import report_date, report_rows, report_spec
from clearcap.questions.report_source import sha256
from engine.faults.toml_positions import with_positions
from engine.mechanism.base import PositiveNumber, TableModel
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml
from reporting import Design, ReportError, ReportSpec, ResponseSpec, write_report
from reporting.capability.verdict import CAPABLE
from reporting.comparison import Validation, validation
from reporting.gauge import BiasStudy, GaugeStudy, gauge_bias, gauge_repeatability
from reporting.samples import read_samples
from reporting.spec import ChartPlan
from reporting.write import USUAL

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

MOST_PARTS = 1_000_000
_LOT, _SUBGROUP = "production lot", "rational subgroup"  # columns of the report's table; no characteristic has a space
_MEASURED = Design(True, "Measured parts.")


class Characteristic(Response):
    """A measured characteristic: a column of the table, and its limits."""

    title: str = Field("", description="What is measured, in words.")
    unit: str = Field(default="1", description="Unit of the column and of the limits; 1 if it has none.")
    column: str | None = Field(None, min_length=1, description="The column; the characteristic's name if absent.")
    gauge_sigma: PositiveNumber | None = Field(
        None,
        description="Standard deviation of the measuring system (repeatability and reproducibility), in the unit:"
        " the report adds the index of the process without it.",
    )
    gauge_freedom: PositiveNumber | None = Field(
        None,
        description="Degrees of freedom of gauge_sigma, as clearcap gauge prints them; known exactly if absent.",
    )
    uncertainty: PositiveNumber | None = Field(
        None,
        description="Expanded uncertainty U of a measurement (k = 2), in the unit: a part conforms for certain only"
        " within the limits less U (ISO 14253-1).",
    )

    @model_validator(mode="after")
    def _freedom_is_that_of_a_sigma(self) -> Self:
        if self.gauge_freedom is not None and self.gauge_sigma is None:
            raise ValueError("gauge_freedom: belongs to gauge_sigma; give both, or neither")
        return self


class PartFields(TableModel, strict=True):
    """What a PPAP or VDA report says at its head of the part and of how it was measured."""

    number: str = Field("", description="Number of the part.")
    name: str = Field("", description="Name of the part.")
    drawing: str = Field("", description="Number of the drawing.")
    revision: str = Field("", description="Revision of the drawing.")
    machine: str = Field("", description="Machine, tool or cavity that made the parts.")
    gauge: str = Field("", description="Measuring equipment.")
    operator: str = Field("", description="Who measured.")

    def fields(self, parts: int) -> dict[str, str]:
        """Return what is given, by its name in the report, with the number of parts."""
        named = {"number": "part number", "name": "part name"}
        given = {named.get(key, key): text for key, text in self if text}
        return {**given, "sample size": str(parts)} if given else {}


class LimitsFile(TableModel, strict=True):
    """Limits of measured characteristics, and what the columns of the table mean."""

    format: Literal[1] = Field(1, description="Version of this file format: 1.")
    title: str = Field("", description="Heading of the report; the name of the table's file if absent.")
    author: str = Field("", description="Who is responsible for the report.")
    part: PartFields = Field(
        PartFields(), description="The part and how it was measured, at the head of report and summary."
    )
    header: dict[str, str] = Field({}, description="Further texts under the title, as customer or conclusion.")
    order: str | None = Field(
        None,
        min_length=1,
        description="The column by which parts were made one after the other, a time or a number; if absent, the rows"
        " are in that order.",
    )
    ordered: bool = Field(True, description="false: the rows are in no order, so that nothing is said of stability.")
    sheet: str | None = Field(None, min_length=1, description="The sheet of an Excel file; the first if absent.")
    lot: str | None = Field(None, min_length=1, description="The column that names each part's lot.")
    subgroup: Annotated[str, Field(min_length=1)] | Annotated[int, Field(ge=2)] | None = Field(
        None,
        description="Rational subgroups for the control chart: the column that names each part's, or how many"
        " consecutive parts are one; if absent, there are none.",
    )
    chart: Literal["i-mr", "xbar-r", "xbar-s", "ewma"] | None = Field(
        None,
        description="Control chart: individuals, means of subgroups with their ranges or standard deviations, or"
        " exponentially weighted moving averages; if absent, the subgroups decide.",
    )
    ewma_weight: Annotated[float, Field(ge=0.01, le=1)] | None = Field(
        None, description="Weight of the newest point in a moving average, 0.01 to 1; 0.2 if absent."
    )
    rules: (
        Literal["nelson", "western electric"]
        | Annotated[list[Annotated[int, Field(ge=1, le=8)]], Field(min_length=1)]
        | None
    ) = Field(
        None,
        description="Tests of the control chart: all eight of Nelson, the four of Western Electric, or a list of"
        " numbers of Nelson's; [1, 2, 3] if absent.",
    )
    requirements: dict[ShortName, PositiveNumber] = Field(
        {}, description="Classes of characteristics, and the index that each requires."
    )
    characteristics: dict[ShortName, Characteristic] = Field(
        min_length=1, max_length=200, description="The characteristics by name."
    )

    @model_validator(mode="after")
    def _chart_fits(self) -> Self:
        if self.chart in ("xbar-r", "xbar-s") and self.subgroup is None:
            raise ValueError(f'chart = "{self.chart}": needs subgroup, a column or a number of consecutive parts')
        if self.chart == "i-mr" and self.subgroup is not None:
            raise ValueError('chart = "i-mr": is a chart of single values; leave subgroup out, or take "xbar-r"')
        if self.chart == "ewma" and self.rules is not None:
            raise ValueError("rules: moving averages are not independent, their limits are their only test; leave out")
        if self.chart != "ewma" and self.ewma_weight is not None:
            raise ValueError('ewma_weight: is for chart = "ewma"; leave it out')
        return self

    def charts(self) -> ChartPlan:
        """Return which control chart the characteristics get."""
        known = {"nelson": range(1, 9), "western electric": range(1, 5), None: (1, 2, 3)}
        numbers = sorted(set(self.rules)) if isinstance(self.rules, list) else known[self.rules]
        family = "western electric" if self.rules == "western electric" else "nelson"
        return ChartPlan(self.chart or "", tuple(f"{family} {n}" for n in numbers), self.ewma_weight or 0.2)

    @model_validator(mode="after")
    def _classes_are_known(self) -> Self:
        for name, each in self.characteristics.items():
            if isinstance(each.requirement, str) and each.requirement not in self.requirements:
                known = ", ".join(self.requirements) or "none is given"
                raise ValueError(
                    f'characteristics.{name}.requirement = "{each.requirement}": no such class; allowed: a number, or'
                    f" one of requirements: {known}"
                )
        return self


def load_limits(source: "str | Path | Mapping[str, Any]") -> LimitsFile:
    """Return checked limits from a TOML file or from its tables; SpecError tells all faults."""
    if isinstance(source, Mapping):
        return _checked(dict(source), "limits:", b"")
    try:
        content = read_regular_file(source, LARGEST)
        return _checked(parse_toml(content), f"limits {source}:", content)
    except OSError as error:
        raise SpecError(f"limits {source}: cannot be read ({error.strerror or error}); name a limits file") from error
    except UnfitToml as error:
        at = SpecFault((), str(error), line=error.line, column=error.column)
        raise SpecError(f"limits {source}: {error}", [at]) from error


def _checked(tables: dict[str, Any], heading: str, content: bytes) -> LimitsFile:
    try:
        return LimitsFile.model_validate(tables)
    except ValidationError as error:
        faults = structure_faults(error, LimitsFile)
        message = "\n  ".join([heading, *map(str, faults)])
        raise SpecError(message, with_positions(faults, content) if content else faults) from error


def parts_table(parts: "pd.DataFrame", limits: LimitsFile) -> "pa.Table":
    """Return the rows of a report in the order in which parts were made, NaN where there is no value; SpecError."""
    import pyarrow as pa

    n, keys = len(parts), dict[str, str]()
    for name, each in limits.characteristics.items():
        keys.setdefault(each.column or name, f"characteristics.{name}" + ".column" * (each.column is not None))
    numbers = numbers_of(parts, keys)
    has_value = np.any([np.isfinite(each) for each in numbers.values()], axis=0)
    if not has_value.any() or n > MOST_PARTS:
        raise SpecError(f"the table has {has_value.sum()} rows with a value, {n} in all; allowed: 1 to {MOST_PARTS}")
    order = np.arange(n) if limits.order is None else ranks_of(parts, limits.order, "order")
    columns: dict[str, Any] = {
        name: numbers[each.column or name][order] for name, each in limits.characteristics.items()
    }
    if limits.lot is not None:
        columns[_LOT] = _numbered(labels_of(parts, limits.lot, "lot"), order)
    if isinstance(limits.subgroup, int):
        columns[_SUBGROUP] = np.arange(n) // limits.subgroup
    elif limits.subgroup is not None:
        columns[_SUBGROUP] = _numbered(labels_of(parts, limits.subgroup, "subgroup"), order)
    fixed = {"sample": np.arange(n), "status": ["ok"] * n, "message": [""] * n, "settled": np.ones(n, bool)}
    zeros = {name: np.zeros(n) for name in ("max_residual", "max_penetration")}
    return pa.table({**fixed, **zeros, **columns})


def _numbered(labels: list[str], order: "np.ndarray[Any, np.dtype[np.intp]]") -> "np.ndarray[Any, Any]":
    """Return the number of each part's lot or subgroup, in the order in which they begin."""
    texts = np.array(labels)[order]
    _, first, number = np.unique(texts, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[number])


def _response(each: Characteristic, limits: LimitsFile, name: str) -> ResponseSpec:
    lsl, usl, target = each.limits()
    required = limits.requirements[each.requirement] if isinstance(each.requirement, str) else each.requirement
    return ResponseSpec(
        *(name, each.title, each.unit, lsl, usl, target, each.source),
        requirement=CAPABLE if required is None else required,
        index=each.index or "share",
        characteristic_class=each.requirement if isinstance(each.requirement, str) else "",
        boundary=each.boundary or "",
        gauge_sigma=each.gauge_sigma,
        gauge_freedom=each.gauge_freedom,
        uncertainty=each.uncertainty,
        historical=None if each.historical is None else (each.historical.mean, each.historical.sigma),
    )


def capability_report(
    parts: "str | Path | pd.DataFrame",
    limits: "str | Path | Mapping[str, Any] | LimitsFile",
    folder: str | Path = "capability",
    kinds: Collection[str] = USUAL,
) -> dict[str, str]:
    """Write the capability report of measured parts.

    Parameters
    ----------
    parts : str, Path or pandas.DataFrame
        The measurements, one row a part: a CSV, Parquet or Excel file, or a table. An empty cell is a missing value.
    limits : str, Path or mapping
        The characteristics and their limits: a TOML file, or its tables.
    folder : str or Path
        Folder of the files; created if it does not exist.
    kinds : collection of str
        Files to write: "html", "json", "parquet", "xlsx" (extra ``clearcap[excel]``), "pdf" and "summary_pdf" (extra
        ``clearcap[pdf]``), "summary".

    Returns
    -------
    dict of str to str
        Path of each file by kind.

    Raises
    ------
    SpecError
        The limits are wrong, or the table does not fit them.
    CampaignError
        The report cannot be written.
    """
    table, spec = asked_of_parts(parts, limits)
    try:
        return write_report(table, spec, Path(folder), kinds=kinds)
    except ReportError as error:
        raise (unwritable(str(error), error.__cause__) if error.__cause__ else CampaignError(str(error))) from error


def asked_of_parts(parts: "str | Path | pd.DataFrame", limits: Any) -> "tuple[pa.Table, ReportSpec]":
    """Return the table of a report on measured parts, and what the report needs besides; raises SpecError."""
    known = limits if isinstance(limits, LimitsFile) else load_limits(limits)
    provenance, name, where = {}, "measured parts", "parts"
    if isinstance(parts, str | Path):
        frame, name, where = read_parts(parts, known.sheet), Path(parts).stem, f"parts {parts}"
        digest = sha256(read_regular_file(parts, LARGEST_TABLE))
        provenance = {"table": Path(parts).name, "SHA-256 of the table": digest}
    elif known.sheet is not None:
        raise SpecError(f'sheet = "{known.sheet:.40}": is for an Excel file; leave it out')
    else:
        frame = numbered(parts)
    try:
        table = parts_table(frame, known)
    except SpecError as error:
        raise SpecError(f"{where}: {error}") from error
    provenance |= {"clearcap": clearcap_version(), "Python": platform.python_version()}
    return table, ReportSpec(
        title=known.title or name,
        campaign=name,
        header={**known.part.fields(len(table)), **known.header},
        responses=tuple(_response(each, known, key) for key, each in known.characteristics.items()),
        variables=(),
        provenance=provenance,
        requested=len(frame),
        sampler="measured",
        design=_MEASURED,
        production_batch_column="" if known.lot is None else _LOT,
        author=known.author,
        written=report_date(),
        ordered=known.ordered,
        measured=True,
        subgroup_column="" if known.subgroup is None else _SUBGROUP,
        charts=known.charts(),
    )


def limits_of_columns(parts: "str | Path | pd.DataFrame", units: Mapping[str, str], what: str) -> dict[str, Any]:
    """Return the limits file, without limits, of a table's columns with the names of responses or variables."""
    frame = read_parts(parts) if isinstance(parts, str | Path) else parts
    there = {str(column) for column in frame.columns}
    named = {name: {"unit": unit} for name, unit in units.items() if name in there}
    if not named:
        remedy = f"rename the columns, or give --limits: {', '.join(units)}"
        raise SpecError(f"parts: no column has the name of a {what}; {remedy}")
    return {"characteristics": named}


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
        rows = read_parts(table) if isinstance(table, str | Path) else numbered(table)
        there = [str(column) for column in rows.columns]
        asked = {value: "value", **({reference: "reference"} if reference in there else {})}
        numbers = numbers_of(rows, asked)
        has_value = ~np.isnan(numbers[value])
        rows, x = rows[has_value], numbers[value][has_value]
        known = numbers[reference][has_value] if reference in there else None
        bias = None if known is None else gauge_bias(x, known, confidence=confidence)
        if known is not None and part not in there:
            return Gauge(None, bias)
        parts = np.array(labels_of(rows, part, "part"), object)
        by = np.array(labels_of(rows, operator, "operator"), object) if operator in there else None
        found = gauge_repeatability(x, parts, by, nested=nested, tolerance=tolerance, confidence=confidence)
    except (ReportError, SpecError) as error:
        raise SpecError(str(error) if str(error).startswith("parts ") else f"{where}: {error}") from error
    return Gauge(found, bias)


def validate_campaign(
    parts: "str | Path | pd.DataFrame", campaign_id: str | None = None, store: str | Path = "runs", limits: Any = None
) -> Validation:
    """Return how measured parts compare with the samples of a campaign.

    Parameters
    ----------
    parts : str, Path or pandas.DataFrame
        The measurements, one row a part: a CSV, Parquet or Excel file, or a table. Without `limits`, columns with the
        name of a response are compared, in the unit of the response.
    campaign_id : str, optional
        Id of the campaign; not needed if the store holds only one.
    store : str or Path
        Folder or URL of the store.
    limits : str, Path or mapping, optional
        Limits file of the parts, whose characteristics have the names of responses; it may name columns and lots.

    Returns
    -------
    Validation
        A prediction for each response, with its verdict, and the correlations.

    Raises
    ------
    SpecError
        The table or the limits do not fit the campaign.
    """
    opened = open_store(str(store))
    return validated(opened, opened.plan(opened.find(campaign_id)), parts, limits)


def validated(store: Store, plan: Plan, parts: "str | Path | pd.DataFrame", limits: Any = None) -> Validation:
    """Return what `validate_campaign` returns, of an open store."""
    spec = report_spec(plan, store)
    units = {each.name: each.unit for each in spec.responses}
    table, of_parts = asked_of_parts(parts, limits_of_columns(parts, units, "response") if limits is None else limits)
    try:
        samples = read_samples(report_rows(store, plan), spec)
        return validation(read_samples(table, of_parts), of_parts, samples, spec)
    except ReportError as error:
        raise SpecError(str(error)) from error
