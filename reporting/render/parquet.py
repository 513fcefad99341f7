"""capability.parquet: one row per response, units in the columns' metadata, for collecting many reports."""

import io
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from reporting.analysis import Analysis
from reporting.capability.summary import Capability
from reporting.response import ResponseAnalysis

if TYPE_CHECKING:
    import pyarrow as pa

# Fields of a capability in the unit of the response, which is in the column "unit" of each row.
_IN_UNIT = ("lsl", "usl", "target", "mean", "std", "min", "max", "median")
_PPM = "ppm"


def render_parquet(analysis: Analysis) -> bytes:
    """Return the file: campaign and counts in its metadata, verdict and numbers in its rows."""
    import pyarrow.parquet as pq

    target = io.BytesIO()
    pq.write_table(capability_table(analysis), target, compression="zstd")
    return target.getvalue()


def capability_table(analysis: Analysis) -> "pa.Table":
    """Return verdict and numbers, one row per response, with units, campaign and counts in the metadata."""
    import pyarrow as pa

    rows = [_row(response) for response in analysis.responses]
    schema = [("response", pa.string()), ("title", pa.string()), ("unit", pa.string()), ("verdict", pa.string())]
    schema += [("certain", pa.bool_()), ("verdict_by", pa.string()), ("verdict_reasons", pa.list_(pa.string()))]
    schema += [(name, pa.float64()) for name in ("index", "index_low", "index_high")]
    schema += [("normality", pa.string()), ("distribution", pa.string())]
    schema += [(name, pa.int64() if name in _COUNTS else pa.float64()) for name in _numbers()]
    schema_of_rows = pa.schema([pa.field(name, kind, metadata=_metadata(name)) for name, kind in schema])
    about = {"campaign": analysis.spec.campaign, "title": analysis.spec.title, "format": "2"}
    about |= {name: str(getattr(analysis, name)) for name in ("finished", "ok", "failed", "confidence")}
    return pa.Table.from_pylist(rows, schema=schema_of_rows.with_metadata(about))


_COUNTS = ("n", "dropped", "below", "above", "claim_runs")
_OTHERS = (
    "nonnormal_pp",
    "nonnormal_ppk",
    "nonnormal_ppm",
    "nonnormal_ppm_low",
    "nonnormal_ppm_high",
    "cpk_with_failures",
    "yield",
    "claim_runs",
)


def _numbers() -> list[str]:
    """Return the names of the columns with numbers; an interval has two columns."""
    names: list[str] = []
    for field in fields(Capability):
        if field.name in ("within", "lots", "order", "notes", "confidence"):
            continue
        names += [f"{field.name}_low", f"{field.name}_high"] if "interval" in field.name else [field.name]
    return [*names, *_OTHERS]


def _row(response: ResponseAnalysis) -> dict[str, Any]:
    """Return the row of a response."""
    row: dict[str, Any] = {
        "response": response.spec.name,
        "title": response.spec.title,
        "unit": response.spec.unit,
        "verdict": response.verdict.word,
        "certain": response.verdict.certain,
        "index": response.verdict.index,
        "index_low": response.verdict.index_low,
        "index_high": response.verdict.index_high,
        "verdict_by": response.verdict.by,
        "verdict_reasons": list(response.verdict.reasons),
        "normality": response.normality.verdict,
        "distribution": response.fits.best,
        "cpk_with_failures": response.yield_.cpk if response.yield_ else None,
        "yield": response.yield_.share if response.yield_ else None,
        "claim_runs": response.claim_runs,
    }
    for name, value in vars(response.capability).items():
        if isinstance(value, tuple) and "interval" in name:
            row[f"{name}_low"], row[f"{name}_high"] = value
        else:
            row[name] = value
    of_fit = next((m for m in response.methods if m.method == "percentile"), None)
    share = next((m for m in response.methods if m.method == "z_score"), None)
    row["nonnormal_pp"], row["nonnormal_ppk"] = (of_fit.pp, of_fit.ppk) if of_fit else (None, None)
    # If fitted distributions disagree there is no number, only the interval over all of them.
    row["nonnormal_ppm"] = share.ppm_expected if share and share.ppm_range is None else None
    interval = share.ppm_expected_interval if share else None
    row["nonnormal_ppm_low"], row["nonnormal_ppm_high"] = interval or (None, None)
    return row


def _metadata(name: str) -> dict[str, str]:
    """Return the unit of a column."""
    if name in _IN_UNIT:
        return {"unit": "of the row"}
    return {"unit": "ppm"} if _PPM in name else {"unit": "1"}
