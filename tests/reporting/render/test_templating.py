"""The environment of the report's templates."""

from reporting.render.templating import environment


def test_templates_are_compiled_once():
    """Every page is made with what the first one has compiled: the same environment, the same templates."""
    pages = [environment().get_template("report.html.j2") for _ in range(2)]
    assert pages[0] is pages[1]
