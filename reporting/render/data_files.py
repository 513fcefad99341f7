"""The report as data: capability.json, with all numbers of the page and its figures, its schema; capability.parquet."""

import io
import json
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

from reporting.analysis import Analysis
from reporting.capability.summary import Capability
from reporting.capability.verdict import CAPABLE, MARGINAL
from reporting.response import ResponseAnalysis

if TYPE_CHECKING:
    import pyarrow as pa


# History: 1 is the first version. 2 adds sampling, shares, shape, methods, running index, sensitivity, correlations,
# advice, comparison, and the command that replays a sample.
FORMAT = 2

_OF_SPEC = (
    *("title", "campaign", "author", "ended", "written", "header", "assumptions"),
    *("requested", "sampler", "stop", "replay"),
)
_OF_VERDICT = {
    **{"certain": "certain", "verdict_by": "by", "verdict_reasons": "reasons"},
    **{"index": "index", "index_low": "index_low", "index_high": "index_high", "assumes": "assumes", "verdict": "word"},
}
_POINTS = ("x", "y")  # points of figures, left out: the store has the samples
_REPEATED = ("lsl", "usl", "target")  # inside a capability these only repeat its arguments


def document(analysis: Analysis) -> dict[str, Any]:
    """Return the analysis as plain data; numbers that are undefined are None."""
    body = asdict(analysis)
    spec = body.pop("spec")
    for response in body["responses"]:
        response["yield"] = response.pop("yield_")
        for name in _REPEATED:
            del response["capability"][name]
        for scatter in response["scatters"]:
            for name in _POINTS:
                del scatter[name]
        response |= {name: response["verdict"][key] for name, key in _OF_VERDICT.items()}
    return {
        "format": FORMAT,
        **{name: spec[name] for name in _OF_SPEC},
        "thresholds": {"capable": CAPABLE, "marginal": MARGINAL},
        **body,
        "provenance": spec["provenance"],
    }


def render_json(analysis: Analysis) -> str:
    """Return the document as text, the same text for the same analysis, without NaN and Infinity."""
    return json.dumps(document(analysis), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def report_schema() -> dict[str, Any]:
    """Return the JSON Schema of capability.json."""
    from pydantic import TypeAdapter

    schema = TypeAdapter(Analysis).json_schema(mode="serialization")
    models = schema.pop("$defs")
    spec = models.pop("ReportSpec")["properties"]
    response = models["ResponseAnalysis"]
    response["properties"]["yield"] = response["properties"].pop("yield_")
    response["required"] = ["yield" if name == "yield_" else name for name in response["required"]]
    of_verdict = models.pop("CapabilityVerdict")["properties"]
    response["properties"] |= {name: of_verdict[key] for name, key in _OF_VERDICT.items()}
    response["required"] += [name for name in _OF_VERDICT if name != "verdict"]
    for name in _POINTS:
        del models["Scatter"]["properties"][name]
        models["Scatter"]["required"].remove(name)
    # A copy: in a comparison the limits are not repeated elsewhere, so its capabilities keep the keys deleted below.
    models["ComparedCapability"] = json.loads(json.dumps(models["Capability"]))
    for name in _REPEATED:
        del models["Capability"]["properties"][name]
        models["Capability"]["required"].remove(name)
    for name in ("capability", "capability_other"):
        models["ResponseComparison"]["properties"][name] = {"$ref": "#/$defs/ComparedCapability"}
    numbers = {"type": "object", "additionalProperties": {"type": "number"}}
    del schema["properties"]["spec"]
    properties = {
        "format": {"const": FORMAT},
        **{name: spec[name] for name in (*_OF_SPEC, "provenance")},
        "thresholds": numbers,
        **schema["properties"],
    }
    for model in [*models.values(), schema]:
        if isinstance(model.get("description"), str):
            model["description"] = " ".join(model["description"].split("\n\n")[0].split())
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "capability.json",
        "description": "The content of a capability report; lengths and responses are in the units of their spec.",
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
        "$defs": models,
    }


# Fields of a capability in the unit of the response, which is in the column "unit" of each row.
_IN_UNIT = ("lsl", "usl", "target", "mean", "std", "min", "max", "median")
_PPM = "ppm"
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
