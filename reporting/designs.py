"""What samples of each sampler are, and how far the intervals of this report hold for them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Design:
    """Samples of one kind.

    Attributes
    ----------
    production : bool
        The samples stand for what would be produced: their sigma and capability mean something.
    text : str
        What follows for the reader.
    """

    production: bool
    text: str


CORNERS, SALTELLI = "worst_case", "saltelli"
_EVEN = (
    "the intervals are those of independent samples. Means and sigmas of responses close to a sum of effects of single "
    "variables are known better than they say (conservative); shares far out in a tail about as well as they say."
)
DESIGNS = {
    "random": Design(True, "Independent random samples: the intervals hold as they are."),
    "lhs": Design(True, f"Latin hypercube: every variable is spread evenly over its distribution, so {_EVEN}"),
    "sobol": Design(True, f"Scrambled Sobol' sequence: evenly spread in all variables at once, so {_EVEN}"),
    "halton": Design(True, f"Scrambled Halton sequence: evenly spread in all variables at once, so {_EVEN}"),
    SALTELLI: Design(
        True,
        "Saltelli's design: two scrambled Sobol' samples A and B, and A with one variable at a time of B's. Runs that "
        "repeat values of others are no further draws: every statistic, interval, share and tail here is over A and B "
        "alone, 2 of k + 2 runs with k variables; the others serve the total indices. For A and B, evenly spread, "
        f"{_EVEN}",
    ),
    CORNERS: Design(
        False,
        "The samples are the corners of the variables' ranges and their middle, not a production: read the worst case; "
        "sigma, indices and ppm describe the corners only, and no verdict follows from them.",
    ),
    "grid": Design(
        False,
        "The samples are the points of a grid, not a production: sigma, indices and ppm describe the grid only, and no "
        "verdict follows from them; read minima, maxima and what moves the responses.",
    ),
    "list": Design(
        False,
        "The samples are a given list; nothing says that they stand for a production: sigma, indices and ppm describe "
        "the list only, and no verdict follows from them.",
    ),
}


def design(sampler: str) -> Design:
    """Return what samples of a sampler are; those of an unknown one pass for independent ones."""
    return DESIGNS.get(sampler, Design(True, f"Sampler {sampler}: the intervals are those of independent samples."))
