"""Whether values in the order in which parts were made look like those of a stable process.

Capability and its intervals take the order for accidental. Measured parts have one: tools wear, shifts and batches of
material differ, and neighbours resemble each other. Three tests of the ranks, so of any distribution, ask whether the
order is accidental; each sees what the others overlook:

- neighbours: serial correlation of each value with the next (Wald and Wolfowitz 1943, on ranks);
- trend: rank correlation with the place (Spearman);
- groups: differences between groups of consecutive values, as many groups as values in each (Kruskal and Wallis 1952).

Mean and variance of the first two are exact for any ties. Neighbours may resemble each other too much, or differ too
much: parts come from two spindles in turn, or a machine is readjusted after each part.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtr

from reporting.arrays import Array, centred_ranks

# At most this share of stable processes raises an alarm. Measured: see docs/report.md, "Order of the rows".
FALSE_ALARMS = 0.01
# Fewer values, or lots, show only what is plain to see; of fewer different ones the tests raise too many alarms.
FEWEST, FEWEST_DIFFERENT = 20, 5
_TESTS = 3
DIFFER = "differ more than chance would have it"


@dataclass(frozen=True)
class RowOrder:
    """What the order of the values says of the process that made them."""

    n: int  # values, or lots
    neighbours: float  # rank correlation of each value with the next one
    trend: float  # rank correlation of the values with their place
    between: float  # share of the variance of the ranks that lies between groups of consecutive values
    # Of the most conspicuous of the three, corrected for their number: in at most this share of stable processes the
    # order is as conspicuous by chance.
    p: float
    seen: str  # what is conspicuous; empty if p is not below `FALSE_ALARMS`
    finding: str  # what is wrong and what to do, in sentences; empty like `seen`


def row_order(x: Array, lots: NDArray[np.generic] | None = None) -> RowOrder | None:
    """Return what the order of values, or of means of lots, says; None below `FEWEST` or `FEWEST_DIFFERENT`."""
    values = x
    if lots is not None:
        _, first, group = np.unique(lots, return_index=True, return_inverse=True)
        values = (np.bincount(group, weights=x) / np.bincount(group))[np.argsort(first)]
    n = values.size
    if n < FEWEST or np.unique(values).size < FEWEST_DIFFERENT:
        return None
    centred = centred_ranks(values)
    squares = float(np.sum(centred**2))
    products = float(centred[:-1] @ centred[1:])
    mean, variance = neighbours_in_random_order(centred)
    neighbours, p_neighbours = products / squares, 2 * float(ndtr(-abs(products - mean) / math.sqrt(variance)))
    place = np.arange(n) - (n - 1) / 2
    trend = float(centred @ place) / math.sqrt(squares * float(place @ place))
    # Over all orders a rank correlation has the variance 1 / (n - 1).
    p_trend = 2 * float(ndtr(-abs(trend) * math.sqrt(n - 1)))
    groups = np.array_split(centred, round(math.sqrt(n)))
    between = sum(group.sum() ** 2 / group.size for group in groups) / squares
    p_groups = float(chdtrc(len(groups) - 1, (n - 1) * between))
    # Bonferroni: the three tests look at the same ranks, so their p-values are dependent.
    p = min(_TESTS * min(p_neighbours, p_trend, p_groups), 1.0)
    seen = finding = ""
    if p < FALSE_ALARMS:
        seen = _seen((p_neighbours, neighbours), (p_trend, trend), (p_groups, between))
        finding = _finding("values" if lots is None else "lots", p, seen)
    return RowOrder(n, neighbours, trend, float(between), p, seen, finding)


def neighbours_in_random_order(centred: Array) -> tuple[float, float]:
    """Return mean and variance of the sum of products of neighbours, over all orders of at least 4 values of mean 0."""
    n, squares, fourth = centred.size, float(np.sum(centred**2)), float(np.sum(centred**4))
    of_two = (squares**2 - fourth) / (n * (n - 1))
    of_three = (2 * fourth - squares**2) / (n * (n - 1) * (n - 2))
    of_four = (3 * squares**2 - 6 * fourth) / (n * (n - 1) * (n - 2) * (n - 3))
    mean = -squares / n
    return mean, (n - 1) * of_two + 2 * (n - 2) * of_three + (n - 2) * (n - 3) * of_four - mean**2


def _seen(neighbours: tuple[float, float], trend: tuple[float, float], groups: tuple[float, float]) -> str:
    """Return what raises the alarm; each test by its p-value and its number."""
    seen = []
    if _TESTS * trend[0] < FALSE_ALARMS:
        seen.append(f"they {'rise' if trend[1] > 0 else 'fall'} from row to row (rank correlation {trend[1]:+.2f})")
    if _TESTS * neighbours[0] < FALSE_ALARMS:
        word = "resemble each other" if neighbours[1] > 0 else DIFFER
        seen.append(f"neighbours {word} (rank correlation {neighbours[1]:+.2f})")
    if not seen:
        seen.append(f"consecutive groups differ ({100 * groups[1]:.0f} % of the variance lies between them)")
    return ", and ".join(seen)


def _finding(what: str, p: float, seen: str) -> str:
    """Return what is wrong and what to do."""
    remedy = "; if they were made in lots, give the lot of each" if what == "values" else ""
    chance = "< 0.0001" if p < 1e-4 else f"= {p:.2g}"
    said = f"The {what} are not in random order (p {chance}): {seen}."
    if seen.startswith(f"neighbours {DIFFER}"):
        return (
            f"{said} They may come from two sources in turn (spindles, cavities, fixtures), or the machine is "
            "readjusted after each part: the intervals, which take them for independent, are too wide or too narrow. "
            "Find the cause; analyse the sources apart."
        )
    return (
        f"{said} The process was not stable, so the intervals are too narrow and say little about the parts that it "
        f"will make next. Find the cause{remedy}."
    )
