"""The environment of the report's templates: number formats, and figures that are safe to insert."""

from collections.abc import Iterable
from functools import cache
from itertools import groupby
from operator import attrgetter
from typing import Any

from jinja2 import Environment
from markupsafe import Markup

from reporting import format_numbers
from reporting.capability.shares import largest_z, least_ppm
from reporting.render import axes, figures, histograms, scatter_figure
from reporting.render.page_templates import page_environment


@cache
def environment() -> Environment:
    """Return the environment of the templates, with filters for numbers and figures.

    It is created once: it caches compiled templates, and compiling takes most of the time of a page.
    """
    made = page_environment("reporting.render")
    made.filters.update(
        fixed=format_numbers.fixed,
        z=format_numbers.z_score,
        least_ppm=least_ppm,
        largest_z=largest_z,
        share=format_numbers.part,
        p=format_numbers.probability,
        unit=axes.unit_suffix,
        places=format_numbers.decimals_for,
        assumed=_assumed_text,
        grouped_by=_grouped_by,
        histogram=lambda r: as_markup(histograms.response_figure(r)),
        probability_plot=lambda r: as_markup(figures.probability_figure(r)),
        convergence_plot=lambda r: as_markup(figures.convergence_figure(r)),
        tornado=lambda r: as_markup(figures.tornado_figure(r)),
        variable_histogram=lambda v: as_markup(histograms.variable_figure(v)),
        scatter_plot=lambda s, r, unit: as_markup(scatter_figure.scatter_figure(r, s, unit)),
        slope_unit=scatter_figure.slope_unit,
        compared=lambda c: as_markup(histograms.compared_figure(c)),
    )
    return made


def _grouped_by(items: Iterable[Any], attribute: str) -> list[tuple[Any, list[Any]]]:
    """Return groups of consecutive items with the same attribute, in order."""
    return [(kind, list(members)) for kind, members in groupby(items, attrgetter(attribute))]


def _assumed_text(value: float | tuple[float, ...] | str) -> str:
    """Return the value of an assumption as text, not rounded."""
    if isinstance(value, tuple):
        return f"({', '.join(map(format_numbers.plain, value))})"
    return value if isinstance(value, str) else format_numbers.plain(value)


def as_markup(svg: str | None) -> Markup | None:
    """Return a figure marked as safe HTML."""
    return None if svg is None else Markup(svg)
