"""Time-dependent distribution model of measured values, ISO 22514-2: what changes in the process, and how.

Groups of values that were made together (subgroups, lots, else consecutive values) show whether location and spread of
the process stay the same; the shape of the values, of those within groups, or of the means of groups does the rest:

| class | location | spread | within groups | all values |
| A1 | constant | constant | normal | normal |
| A2 | constant | constant | any | not normal |
| B | constant | varies | normal | not normal |
| C1 | varies at random | constant | normal | normal |
| C2 | varies at random | constant | normal | not normal |
| C3 | systematic | constant | any | any |
| C4 | systematic and at random | constant | any | any |
| D | varies | varies | any | any |

Each question is answered by a test at 1 %, so that a process of class A1 is rarely called another one (measured in
studies/time_models.md):

- location: analysis of variance of the ranks between groups (Conover and Iman 1981), and the order of their means;
- spread: the coefficient of variation of the standard deviations of groups among random orders of the values, or of
  their distances from the means of their groups where these differ, and the order of the standard deviations;
- systematic: the means of groups are not in random order (`reporting.capability.row_order`);
- at random beside that: neighbouring means differ more than the values within groups explain (von Neumann 1941).

Few values often do not show a spread that varies, or the shape of the means. What they do not exclude for that reason
is named beside the class, so that no class promises more than its values tell.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from reporting.arrays import Array, centred_ranks
from reporting.capability.row_order import row_order
from reporting.shape.normality import Normality, departs, normality

LEVEL = 0.01  # of each test
FEWEST_GROUPS, USUAL_SIZE, FEWEST_VALUES = 20, 5, 40
# With so many degrees of freedom within groups a varying spread, with so many groups the shape of their means, is seen
# in nine of ten processes of studies/time_models.md; so 50 groups of 5 exclude all that can be.
ENOUGH_FREEDOM, ENOUGH_GROUPS = 200, 50
_ORDERS, _MOST_PERMUTED = 999, 5_000
WORDS = {
    "A1": "location and spread are constant, values are normal",
    "A2": "location and spread are constant, values are not normal",
    "B": "the location is constant, the spread varies",
    "C1": "the location varies at random, normally; the spread is constant",
    "C2": "the location varies at random, values are not normal; the spread is constant",
    "C3": "the location changes systematically, the spread is constant",
    "C4": "the location changes systematically and at random, the spread is constant",
    "D": "location and spread vary",
}


@dataclass(frozen=True)
class TimeModel:
    """The model class of a characteristic, and what it rests on; p is by chance alone, None where it is not asked."""

    name: str  # "A1" to "D"; empty if the values do not tell
    text: str  # in words, with the numbers it rests on, or why there is none
    of: str = ""  # "subgroups", "lots" or "consecutive values"
    groups: int = 0
    size: int = 0  # fewest values in a group
    between: float | None = None  # share of the variance of the ranks that lies between groups
    p_location: float | None = None  # of means of groups that differ as much
    p_order: float | None = None  # of means of groups in such an order
    p_spread: float | None = None  # of spreads of groups that differ as much, or are in such an order
    p_jumps: float | None = None  # of such differences between neighbouring means, beside what changes slowly
    p_normal: float | None = None  # of such a shape: of all values where the location is constant, else within groups
    p_means: float | None = None  # of such a shape of the means of groups
    possible: tuple[str, ...] = ()  # classes that so few values do not exclude

    @property
    def label(self) -> str:
        """The class, and those that are not excluded."""
        return " or ".join((self.name, *self.possible))


def time_model(x: Array, groups: NDArray[np.generic] | None, of: str) -> TimeModel:
    """Return the model class of finite values in the order in which they were made.

    `groups`, shape (n,), numbers the group of each value, in order; without it consecutive values are groups.
    """
    if groups is None:
        size, of = min(USUAL_SIZE, x.size // FEWEST_GROUPS), "consecutive values"
        if x.size < FEWEST_VALUES:
            return TimeModel("", f"No model class: {x.size} values, {FEWEST_VALUES} are needed.", of)
        groups = np.minimum(np.arange(x.size) // size, x.size // size - 1)
    _, number, counts = np.unique(groups, return_inverse=True, return_counts=True)
    kept = counts[number] > 1
    x, number = x[kept], np.unique(number[kept], return_inverse=True)[1]
    counts = counts[counts > 1]
    k = counts.size
    if k < FEWEST_GROUPS:
        what = f"{k} {of} of two or more values, {FEWEST_GROUPS} are needed"
        return TimeModel("", f"No model class: {what}.", of, k)
    order = np.argsort(number, kind="stable")
    return _classified(x[order], number[order], counts, of)


def _classified(x: Array, number: NDArray[np.intp], counts: NDArray[np.intp], of: str) -> TimeModel:
    """Return the class of values sorted by group."""
    k, n, starts = counts.size, x.size, np.cumsum(counts) - counts
    means = np.add.reduceat(x, starts) / counts
    residuals = x - means[number]
    spreads = np.sqrt(np.add.reduceat(residuals**2, starts) / (counts - 1))
    if not float(np.ptp(x)) > 0 or not float(spreads.max()) > 0:
        return TimeModel("", "No model class: values within groups do not differ.", of, k, int(counts.min()))
    ranks = centred_ranks(x)
    between = float(np.sum(np.add.reduceat(ranks, starts) ** 2 / counts) / np.sum(ranks**2))
    ratio = between / (k - 1) / ((1 - between) / (n - k)) if between < 1 else math.inf
    p_location = float(fdtrc(k - 1, n - k, ratio))
    in_order, spread_order = row_order(means), row_order(spreads)
    p_order = 1.0 if in_order is None else in_order.p
    moves = min(p_location, p_order) < LEVEL
    p_of_size = _p_of_spreads(residuals if moves else x, counts)  # values of a constant location may change places
    p_spread = min(2 * min(p_of_size, 1.0 if spread_order is None else spread_order.p), 1.0)
    spreads_vary = p_spread < LEVEL
    shape = normality(residuals / np.sqrt(1 - 1 / counts)[number] if moves else x)
    of_means = normality(means) if moves else None
    # neighbouring means: a slow change hardly moves them, one at random does
    within = float(np.sum(residuals**2)) / (n - k)
    steps = float(np.mean(np.diff(means) ** 2 / (1 / counts[1:] + 1 / counts[:-1])))
    p_jumps = float(fdtrc(2 * (k - 1) ** 2 / (3 * k - 4), n - k, steps / within))
    name = _name(moves, p_order < LEVEL, p_jumps < LEVEL, spreads_vary, _is_normal(shape), of_means)
    found = TimeModel(
        name=name,
        text="",
        of=of,
        groups=k,
        size=int(counts.min()),
        between=between,
        p_location=p_location,
        p_order=p_order,
        p_spread=p_spread,
        p_jumps=p_jumps if moves else None,
        p_normal=shape.p,
        p_means=None if of_means is None else of_means.p,
        possible=_not_excluded(name, k, n - k),
    )
    return TimeModel(**{**found.__dict__, "text": _text(found)})


def _name(moves: bool, in_turn: bool, jumps: bool, spreads: bool, normal: bool, of_means: Normality | None) -> str:
    """Return the class from the answers to each question."""
    if not moves:
        return "B" if spreads else "A1" if normal else "A2"
    if spreads:
        return "D"
    if in_turn:
        return "C4" if jumps else "C3"
    return "C1" if normal and of_means is not None and _is_normal(of_means) else "C2"


def _not_excluded(name: str, groups: int, freedom: int) -> tuple[str, ...]:
    """Return the classes whose processes would often be called `name` with so few values."""
    found = ["C2"] if name == "C1" and groups < ENOUGH_GROUPS else []
    if freedom < ENOUGH_FREEDOM and name not in ("B", "D"):
        found.append("B" if name in ("A1", "A2") else "D")
    return tuple(found)


def _is_normal(shape: Normality) -> bool:
    """Return whether values are normal, or close enough where a test of many values sees the least departure."""
    return shape.verdict in ("normal", "close to normal") or not departs(shape, 1, LEVEL)


def _p_of_spreads(x: Array, counts: NDArray[np.intp]) -> float:
    """Return in which share of random orders of the values the spreads of groups vary as much as here."""
    r, m = _fewer(x - x.mean(), counts)
    starts = np.cumsum(m) - m
    random = np.random.Generator(np.random.PCG64(r.size)).permuted(np.tile(r, (_ORDERS, 1)), axis=1)
    orders = np.vstack([r, random])
    sums = np.add.reduceat(orders, starts, axis=1)
    squares = np.add.reduceat(orders**2, starts, axis=1) - sums**2 / m
    spreads = np.sqrt(np.maximum(squares, 0.0) / (m - 1))
    varies = spreads.std(axis=1) / spreads.mean(axis=1)
    return float(np.mean(varies >= varies[0] * (1 - 1e-12)))


def _fewer(x: Array, counts: NDArray[np.intp]) -> tuple[Array, NDArray[np.intp]]:
    """Return some of very many values, evenly spaced, and how many in each group: of large groups, then of groups."""
    if x.size <= _MOST_PERMUTED:
        return x, counts
    step = -(-counts // max(_MOST_PERMUTED // counts.size, USUAL_SIZE))
    place = np.arange(x.size) - np.repeat(np.cumsum(counts) - counts, counts)
    x, counts = x[place % np.repeat(step, counts) == 0], -(-counts // step)
    chosen = np.zeros(counts.size, bool)
    chosen[:: -(-x.size // _MOST_PERMUTED)] = True
    return x[np.repeat(chosen, counts)], counts[chosen]


def _text(found: TimeModel) -> str:
    """Return the class in words, and what it rests on."""
    what = f"{found.groups} {found.of}" if found.of != "consecutive values" else f"{found.groups} groups"
    sizes = f" of {found.size}{'' if found.of == 'consecutive values' else ' or more'}"
    more = " consecutive values" if found.of == "consecutive values" else ""
    shape = "values within groups" if found.p_means is not None else "all values"
    numbers = {
        "means differ": found.p_location,
        "means are not in random order": found.p_order,
        "neighbouring means differ more than values within groups": found.p_jumps,
        "spreads differ": found.p_spread,
        f"{shape} are not normal": found.p_normal,
        "means are not normal": found.p_means,
    }
    listed = ", ".join(f"{words} p {_p(p)}" for words, p in numbers.items() if p is not None)
    words = f"{found.name}: {WORDS[found.name]}. It rests on {what}{sizes}{more}: {listed}."
    for other in found.possible:
        remedy = f"{ENOUGH_GROUPS} groups of {USUAL_SIZE} would"
        words += f" So few values do not exclude {other} ({WORDS[other]}); {remedy}."
    return words


def _p(p: float) -> str:
    return "< 0.0001" if p < 1e-4 else f"= {p:.2g}"
