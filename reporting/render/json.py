"""The report as data: capability.json with every number of the page and of its figures, and its schema."""

import json
from dataclasses import asdict
from typing import Any

from reporting.analysis import Analysis
from reporting.capability.verdict import CAPABLE, MARGINAL

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
