"""The figure over all responses: who is in it, and where."""

from dataclasses import replace

import pyarrow as pa

from reporting.render.html import render_html
from reporting.render.overview import one_sided, out_of_figures, overview_figure
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def test_one_sided_responses_are_in_the_overview() -> None:
    """FC-6 has a lower limit alone; the page says how it is scaled, and that the goal plot lacks it."""
    analysis = analysis_of(c60_table(100), c60_spec(100))
    assert [r.spec.name for r in one_sided(analysis)] == ["FC-6"]
    assert ">FC-6 *</text>" in overview_figure(analysis)
    page = render_html(analysis)
    assert "Not shown, as they have one limit: FC-6." in page
    assert "so that a mean at 0 has Cpk 1.33" in page


def test_a_campaign_of_one_sided_responses_has_a_figure() -> None:
    spec = c60_spec(100)
    first = replace(spec.responses[0], lsl=None, usl=16.0)
    assert ">FC-1 *</text>" in overview_figure(analysis_of(c60_table(100), replace(spec, responses=(first,))))


def test_what_no_figure_shows_is_said() -> None:
    """A constant with limits has no place between them."""
    table, spec = c60_table(100), c60_spec(100)
    at = table.schema.get_field_index("FC-2")
    analysis = analysis_of(table.set_column(at, "FC-2", pa.array([10.5] * 100)), spec)
    assert [r.spec.name for r in out_of_figures(analysis)] == ["FC-2"]
    assert "because values or spread are missing: FC-2." in render_html(analysis)
