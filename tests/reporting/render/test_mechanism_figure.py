"""The drawing of the mechanism as SVG: names are text and never markup, and can be read."""

from reporting.render.figures import mechanism_figure, readable
from reporting.spec import DrawnLine, DrawnWords, LegendEntry, MechanismDrawing

HOSTILE = '</text><script>alert("x")</script>'


def test_names_are_no_markup() -> None:
    drawing = MechanismDrawing(
        100.0,
        80.0,
        12.0,
        ((((0.0, 0.0), (10.0, 0.0), (5.0, 8.0)), "#56B4E9"),),
        (DrawnLine(((0.0, 0.0), (30.0, 0.0)), "#0072B2", "arrow"), DrawnLine(((5.0, 5.0),), "#0072B2", "arrow")),
        ((3.0, 3.0, "#0072B2"),),
        (DrawnWords(50.0, 40.0, (HOSTILE, "second"), "#56B4E9", True),),
        (LegendEntry(HOSTILE, HOSTILE, HOSTILE, "#56B4E9"),),
    )
    svg = mechanism_figure(drawing)
    assert "<script>" not in svg
    assert svg.count("&lt;script&gt;") == 4
    assert svg.count("<polygon") == 2  # the body, and the head of the arrow that has a length


def test_words_are_dark_enough_to_read() -> None:
    """A light blue is darkened, a dark one stays."""
    assert readable("#0072B2").lower() == "#0072b2"
    assert readable("#56B4E9") != "#56b4e9"
    assert readable("#ffffff") < "#808080"
