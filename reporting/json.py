"""The report as data: capability.json, every number of the page and those behind its figures."""

import json
from dataclasses import asdict
from typing import Any

from reporting.analysis import CAPABLE, MARGINAL, Analysis

# History: 1, the first.
FORMAT = 1


def document(analysis: Analysis) -> dict[str, Any]:
    """Return the analysis as plain data; numbers that are undefined are None.

    Parameters
    ----------
    analysis : Analysis
        What the document says.
    """
    body = asdict(analysis)
    spec = body.pop("spec")
    for response in body["responses"]:
        response["yield"] = response.pop("yield_")
        # The limits stand in `spec`; inside the capability they are only what it was called with.
        for name in ("lsl", "usl", "target"):
            del response["capability"][name]
    return {
        "format": FORMAT,
        **{name: spec[name] for name in ("title", "campaign", "header", "requested")},
        "thresholds": {"capable": CAPABLE, "marginal": MARGINAL},
        **body,
        "provenance": spec["provenance"],
    }


def render_json(analysis: Analysis) -> str:
    """Return the document as text, the same for the same analysis; it never holds NaN or Infinity."""
    return json.dumps(document(analysis), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
