"""What the samples of a campaign are, and how far the intervals of a report hold for them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Design:
    """What samples drawn in one way are.

    Attributes
    ----------
    production : bool
        Whether the samples stand for what would be produced: only then sigma and capability mean something.
    text : str
        What follows for the reader of the report.
    """

    production: bool
    text: str


INDEPENDENT = Design(True, "Independent random samples, as the intervals assume.")
