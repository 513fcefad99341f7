"""Tables for narrow screens: every cell of a wide table has the name of its column."""

from reporting.render.html import render_html
from reporting.render.narrow import label_cells
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table

HEAD = (
    '<thead><tr><th rowspan="2">Variable</th><th colspan="2">Mean</th><th rowspan="2">p</th></tr>'
    "<tr><th>asked &#34;for&#34;</th><th>drawn<br>here</th></tr></thead>"
)


def test_cells_have_the_names_of_their_columns() -> None:
    """Of two rows of a head both; a cell over several columns counts as so many."""
    page = f'<table class="x">{HEAD}<tbody><tr><th>J1</th><td class="n">1</td><td>2</td><td>3</td></tr></tbody></table>'
    labelled = label_cells(page)
    assert '<table class="stack x">' in labelled
    assert '<td class="n" data-label="Mean asked &#34;for&#34;">1</td>' in labelled
    assert '<td data-label="Mean drawn here">2</td><td data-label="p">3</td>' in labelled
    wide = label_cells(page.replace("<td>2</td>", "").replace('class="n"', 'colspan="2"'))
    assert '<td data-label="p">3</td>' in wide


def test_narrow_tables_stay_as_they_are() -> None:
    """A table of two columns fits everywhere."""
    page = "<table><thead><tr><th>a</th><th>b</th></tr></thead><tbody><tr><td>1</td><td>2</td></tr></tbody></table>"
    assert label_cells(page) == page


def test_a_name_with_marks_is_text() -> None:
    """A variable's name is a head of the heat map, and becomes an attribute; it does not end it."""
    from dataclasses import replace

    hostile = 'J"1" onmouseover="x" <b>'
    spec, table = c60_spec(60), c60_table(60)
    spec = replace(spec, variables=(replace(spec.variables[0], name=hostile), *spec.variables[1:]))
    table = table.rename_columns([hostile if name == "J1" else name for name in table.column_names])
    page = render_html(analysis_of(table, spec))
    assert ' onmouseover="' not in page
    assert "<b>" not in page
