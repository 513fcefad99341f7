"""Capability reports from a table of samples: numbers, figures, pages.

One analysis model (`reporting.analysis`) has many renderings (`reporting.render.html`, `reporting.render.data_files`).
"""

from typing import TYPE_CHECKING

# at once, because a sub-package of the same name would take its place later
from reporting.capability.summary import Capability, capability

if TYPE_CHECKING:
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


def __getattr__(name: str) -> object:
    """Import a public name at its first use: workers import this package for its distributions, and write no report."""
    from importlib import import_module

    for module in ("spec", "errors", "write"):
        if name in __all__ and hasattr(found := import_module(f"reporting.{module}"), name):
            return getattr(found, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
