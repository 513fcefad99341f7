"""The picture of the mechanism on the page of a report; a mechanism that cannot be drawn costs the picture alone."""

from pathlib import Path

from campaign.reports.mechanism_drawing import mechanism_drawing
from campaign.reports.report import report


def test_the_page_shows_what_is_measured(store, plan):
    """Every response is marked, or listed with what it is."""
    drawing, note = mechanism_drawing(plan)
    assert (drawing is not None, note) == (True, "")
    page = Path(report(store, plan)["html"]).read_text()
    figure = page.split('id="mechanism"')[1].split("</section>")[0]
    assert ">FC-2</text>" in figure
    assert "10.6 mm here" in figure
    assert "1 if latch_overlap &gt; 0, else 0; no place in the picture" in figure
    assert [each.name for each in drawing.legend] == list(plan.mechanism.responses)


def test_a_mechanism_that_cannot_be_drawn_is_said(store, plan, monkeypatch):
    """The report is written without its picture, and says so; the reason is no markup."""

    def fails(mechanism):
        raise ValueError("no <b>way</b>")

    monkeypatch.setattr("campaign.reports.mechanism_drawing.sketch_mechanism", fails)
    page = Path(report(store, plan)["html"]).read_text()
    assert "The mechanism could not be drawn (ValueError: no &lt;b&gt;way&lt;/b&gt;)." in page
    assert "Can these numbers be trusted?" in page
