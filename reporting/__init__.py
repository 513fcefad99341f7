"""Capability reports from a table of samples: numbers, figures, pages.

One analysis model (`reporting.analysis`) has many renderings (`reporting.render.html`, `reporting.render.json`).
"""

from reporting.capability.summary import Capability, capability
from reporting.errors import ReportError
from reporting.spec import Assumption, Design, ReportSpec, ResponseSpec, VariableSpec
from reporting.write import write_report

__all__ = [
    "Assumption",
    "Capability",
    "Design",
    "ReportError",
    "ReportSpec",
    "ResponseSpec",
    "VariableSpec",
    "capability",
    "write_report",
]
