"""The page: what a browser may do with it, its templates, and its tables on narrow screens."""

import base64
import hashlib
import re

from reporting.render.html import environment, label_cells, render_html
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def test_policy() -> None:
    """Nothing is loaded, sent or run, and the one style sheet is named by its hash."""
    page = render_html(analysis_of(c60_table(60, 4), c60_spec(60)))
    [policy] = re.findall(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', page)
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert not {"script-src", "connect-src", "frame-src", "object-src"} & set(rules)
    assert rules["img-src"] == "data:"
    [style] = re.findall(r"<style>(.*?)</style>", page, re.S)
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    assert rules["style-src-elem"] == f"'sha256-{digest}'"
    assert page.index("Content-Security-Policy") < page.index("<title>")


def test_templates_are_compiled_once():
    """Every page is made with what the first one has compiled: the same environment, the same templates."""
    pages = [environment().get_template("report.html.j2") for _ in range(2)]
    assert pages[0] is pages[1]


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
