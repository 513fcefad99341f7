"""The page's words, against those accepted before; numbers are the other tests' business."""

import os
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

from reporting.render.html import render_html
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table, repeats_of

GOLD = Path(__file__).parent / "gold" / "report.txt"
BLOCKS = {"p", "h1", "h2", "h3", "tr", "caption", "li", "dt", "dd", "figcaption", "summary", "title", "small", "svg"}
# Numbers with their groups, signs and exponents; what depends on the last digits of a fit is a number too.
NUMBER = re.compile(r"[-−]?\d[\d\u202f]*(?:\.\d+)?(?:e-?\d+)?")


class Lines(HTMLParser):
    """Collects the page's text and its figures' labels, a line a block."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.lines, self.hidden = [""], 0
        self.feed(page)

    def handle_starttag(self, tag, attributes) -> None:
        """Begin a line with a block; of a figure, give its label."""
        self.hidden += tag in ("style", "svg")
        if tag in BLOCKS:
            self.lines.append(f"[{dict(attributes)['aria-label']}]" if tag == "svg" else "")
        elif tag in ("td", "th"):
            self.lines[-1] += " | "

    def handle_endtag(self, tag) -> None:
        """End what is not text."""
        self.hidden -= tag in ("style", "svg")

    def handle_data(self, data) -> None:
        """Add to the line."""
        self.lines[-1] += "" if self.hidden else data


def words() -> str:
    """Return the page's words."""
    spec = replace(
        c60_spec(300), production_batch_column="", stop="Asked for: cpk.", replay="clearcap replay c60-0123456789"
    )
    table = c60_table(300, 3)
    scatter = {r.name: 0.0 for r in spec.responses} | {"FC-1": 0.2, "FC-4": 0.02}
    against = (c60_table(200, seed=2), c60_spec(200))
    page = render_html(analysis_of(table, spec, against=against, repeats=repeats_of(table, 12, scatter)))
    lines = (" ".join(line.split()) for line in Lines(page).lines)
    return "\n".join(NUMBER.sub("#", line) for line in lines if line) + "\n"


def test_the_page_says_what_was_accepted() -> None:
    """Where this fails and the change is meant: gold/README.md."""
    found = words()
    if os.environ.get("ACCEPT_GOLD"):
        GOLD.write_text(found, encoding="utf-8")
    assert found == GOLD.read_text(encoding="utf-8")
