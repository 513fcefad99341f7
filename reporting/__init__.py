"""Capability reports from a table of samples: numbers, figures, pages.

One analysis model (`reporting.analysis`), many renderings of it (`reporting.render.html`, `reporting.render.json`).
"""

from reporting.capability.capability import Capability, capability
from reporting.errors import ReportError
from reporting.render.write import write_report
from reporting.spec import ReportSpec, ResponseSpec, VariableSpec

__all__ = [
    "Capability",
    "ReportError",
    "ReportSpec",
    "ResponseSpec",
    "VariableSpec",
    "capability",
    "write_report",
]
