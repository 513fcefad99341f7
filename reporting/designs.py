"""How the samples of a campaign were drawn, and to what extent the intervals of a report hold for them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Design:
    """Description of samples drawn by one sampler.

    Attributes
    ----------
    production : bool
        Whether the samples represent production: only then are sigma and capability meaningful.
    text : str
        Consequences for the reader of the report.
    """

    production: bool
    text: str


INDEPENDENT = Design(True, "Independent random samples, as the intervals assume.")
