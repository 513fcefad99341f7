"""The environment of templates: nothing inserted is markup, nothing missing is silent, numbers are the house's."""

import pytest
from jinja2 import UndefinedError

from reporting import format_numbers
from reporting.render.page_templates import page_environment


def test_templates_of_a_package():
    """Each of its templates is found and can be read."""
    environment = page_environment("reporting.render")
    names = environment.list_templates()
    assert names
    for name in names:
        source, _, _ = environment.loader.get_source(environment, name)
        environment.parse(source)


def test_what_is_inserted_is_text():
    environment = page_environment("reporting.render")
    assert environment.from_string("{{ x }}").render(x="<b>&") == "&lt;b&gt;&amp;"
    with pytest.raises(UndefinedError, match="'x' is undefined"):
        environment.from_string("{{ x }}").render()


def test_numbers_are_written_one_way():
    shown = (
        page_environment("reporting.render").from_string("{{ x | significant(4) }} {{ 30850 | grouped }}").render(x=0.1)
    )
    assert shown == f"{format_numbers.significant(0.1, 4)} {format_numbers.grouped(30850)}"
