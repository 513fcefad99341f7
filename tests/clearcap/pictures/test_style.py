"""Pictures are drawn in one style, whatever else there is."""

import io

from matplotlib.figure import Figure

from clearcap.pictures.style import styled


def test_letters_without_a_font_are_drawn_without_a_warning():
    """As the names of parts from a Japanese CAD program: text in SVG is the browser's."""
    file = io.StringIO()
    with styled():
        figure = Figure()
        figure.suptitle("\u8ef8\u53d7 1")
        figure.savefig(file, format="svg")
    assert "\u8ef8\u53d7 1" in file.getvalue()
