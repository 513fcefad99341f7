"""What a reader of the page sees before anything is unfolded."""

import re
from html.parser import HTMLParser


class VisibleWords(HTMLParser):
    """Collects the words outside folds, figures and style, by the id of the element that is asked for."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.text, self._open = list[str](), list[tuple[str, bool]]()
        self.feed(page)

    def handle_starttag(self, tag, attributes) -> None:
        """Note what hides the words within; the summary of an outermost fold stays visible."""
        if tag in ("details", "summary", "style", "title", "svg"):
            hides = tag in ("style", "title") or (tag == "details" and "open" not in dict(attributes))
            self._open.append((tag, hides))

    def handle_endtag(self, tag) -> None:
        """Leave it."""
        if self._open and self._open[-1][0] == tag:
            self._open.pop()

    def handle_data(self, data) -> None:
        """Keep the words that are seen."""
        hiding = [i for i, (_, hides) in enumerate(self._open) if hides]
        is_summary = len(hiding) == 1 and self._open[-1][0] == "summary" and hiding[0] == len(self._open) - 2
        if not hiding or is_summary:
            self.text.append(data)


def visible_words(page: str) -> list[str]:
    """Return the words with a letter that the page shows, those in figures among them."""
    return [word for word in " ".join(VisibleWords(page).text).split() if re.search(r"[^\W\d_]", word)]
