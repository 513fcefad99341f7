"""Coverage of the report's intervals: `python -m studies.coverage` prints how often each contains the true value.

A production draws values whose true mean, sigma, indices and shares are known. The report's own functions analyse each
draw. An interval covers the true value, misses it low or high, has a warning on the page, or is withheld.
"""

import argparse
import math
import os
import platform
import re
import time
import zlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from campaign.row_build import clearcap_version
from studies import show
from studies.coverage.estimates import (
    advice,
    allocations,
    attributions,
    causes,
    changes,
    contents,
    counts,
    differences,
    indices,
    methods,
    pages,
    products,
    stops,
    verdicts,
    verdicts_in_turn,
)
from studies.coverage.outcomes import BY_INDEX, GROUPS, Key, Statement, Tally, details, faults, table, tallied
from studies.coverage.productions import (
    IN_ORDER,
    JUDGED_SHAPES,
    JUMPS,
    LOTS,
    LOTS_IN_TURN,
    MORE_SHAPES,
    SHAPES,
    SIZES,
    Production,
)
from studies.coverage.rare import AIMED, DESIGNED, LITERATURE, designed_shares, rare_shares

SEED = 95
Estimate = Callable[[Production, int, np.random.Generator], Iterator[Statement]]


@dataclass(frozen=True)
class Case:
    """Replications of one estimate for one production and size."""

    estimate: Estimate
    production: Production
    n: int  # number of samples
    replications: int

    def tallies(self) -> dict[Key, Tally]:
        """Draw and judge all replications; replication r does not depend on their number."""
        name = f"{self.estimate.__name__} of {self.production.name}, {self.n}"
        # Not `hash`, which differs between processes: a case has the same draws wherever it is computed.
        seed = (SEED, zlib.crc32(name.encode()))
        found = tallied(
            self.estimate(self.production, self.n, np.random.default_rng((*seed, r))) for r in range(self.replications)
        )
        return {(number, self.production.name, self.n): tally for number, tally in found.items()}


# Replications in the complete study, for each production and size.
REPLICATIONS: dict[Estimate, int] = {
    indices: 500,
    counts: 500,
    methods: 60,
    causes: 60,
    changes: 150,
    advice: 60,
    differences: 150,
    products: 300,
    contents: 300,
}
# Estimates for some productions only.
OF_JUMPS, OF_REJECTS, OF_RARE, OF_DESIGNED, OF_STOPS, OF_VERDICTS = 60, 60, 200, 40, 100, 40
OF_ALLOCATIONS, OF_ORDER, OF_LITERATURE = 10, 250, 60
OF_PAGES = dict(zip(SIZES, (10, 10, 5), strict=True))
LAST = 3200  # values at which a verdict in turn ends


def cases(share: float = 1.0) -> list[Case]:
    """Return all cases with this share of their replications, the longest first."""
    found = [
        Case(estimate, production, n, round(share * replications))
        for estimate, replications in REPLICATIONS.items()
        for production in (*SHAPES, *LOTS)
        for n in SIZES
    ]
    found += [Case(indices, p, n, round(share * OF_ORDER)) for p in (*MORE_SHAPES, *IN_ORDER) for n in SIZES]
    found += [Case(causes, p, n, round(share * OF_JUMPS)) for p in JUMPS for n in SIZES[1:]]
    found += [Case(allocations, p, n, round(share * OF_ALLOCATIONS)) for p in SHAPES for n in SIZES[1:]]
    found += [Case(attributions, p, n, round(share * OF_REJECTS)) for p in (SHAPES[0], *LOTS) for n in SIZES[1:]]
    found += [Case(verdicts, p, n, round(share * OF_VERDICTS)) for p in (*SHAPES, *LOTS) for n in SIZES]
    found += [Case(pages, p, n, math.ceil(share * OF_PAGES[n])) for p in MORE_SHAPES for n in SIZES]
    judged_in_turn = (SHAPES[0], *JUDGED_SHAPES)
    found += [Case(verdicts_in_turn, p, LAST, round(share * OF_VERDICTS)) for p in judged_in_turn]
    found += [Case(rare_shares, p, n, round(share * OF_RARE)) for p in AIMED for n in SIZES[1:]]
    found += [Case(designed_shares, p, max(SIZES), round(share * OF_DESIGNED)) for p in DESIGNED]
    found += [Case(designed_shares, p, max(SIZES), round(share * OF_LITERATURE)) for p in LITERATURE]
    found += [Case(stops, production, max(SIZES), round(share * OF_STOPS)) for production in LOTS_IN_TURN]
    # So that no process is left with a long case when the others have finished.
    return sorted(found, key=lambda case: -case.n * case.replications)


_OF_PAGES = ("mean, sigma", "Pp, Ppk, ppm", "Pareto", "tolerance intervals, normal")
# The productions of each table, its groups of numbers, and whether it has a row for each production.
TABLES: tuple[tuple[tuple[Production, ...], tuple[str, ...], bool], ...] = (
    (SHAPES, tuple(GROUPS), False),
    (MORE_SHAPES, tuple(group for group in GROUPS if group.startswith(_OF_PAGES)), True),
    (MORE_SHAPES, tuple(BY_INDEX), True),
    (JUDGED_SHAPES, ("certain verdicts, in turn",), False),
    (LOTS, tuple(GROUPS), False),
    (IN_ORDER, tuple(GROUPS), True),
    (JUMPS, ("first-order indices", "share of interactions"), False),
    *((productions, tuple(GROUPS), False) for productions in (LOTS_IN_TURN, AIMED, DESIGNED)),
    (LITERATURE, tuple(GROUPS), True),
)


def all_tallies(chosen: list[Case], mapped: Callable[..., Iterable[dict[Key, Tally]]] = map) -> dict[Key, Tally]:
    """Return the tallies of some cases; ``mapped`` is `map` or a parallel substitute."""
    found: dict[Key, Tally] = {}
    for tallies in mapped(Case.tallies, chosen):
        found |= tallies
    return found


def lines(
    chosen: list[Case], mapped: Callable[..., Iterable[dict[Key, Tally]]] = map, *, detailed: bool = False
) -> Iterator[str]:
    """Yield the lines of the tables of some cases; ``mapped`` is `map` or a parallel substitute."""
    began = time.monotonic()
    tallies = all_tallies(chosen, mapped)
    for productions, groups, tall in TABLES:
        found = list(table(tallies, productions, groups, tall=tall))
        if any(cell.strip(" /") for line in found[2:] for cell in line.split("|")[2:]):
            yield from (*found, "")
    if detailed:
        yield from (*details(tallies), "")
    replications = sum(case.replications for case in chosen)
    yield (
        f"clearcap {clearcap_version()}, Python {platform.python_version()}: {replications:,} campaigns of"
        f" {', '.join(f'{n:,}' for n in SIZES)} samples in {(time.monotonic() - began) / 60:.1f} minutes;"
        f" {len(faults(tallies))} of {len(tallies)} intervals at fault."
    )


def main() -> None:
    """Repeat all estimates, or the requested ones, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.coverage", description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="of the replications; default: %(default)s")
    parser.add_argument("--only", default="", metavar="REGEX", help="estimates whose name matches, and no others")
    parser.add_argument("--of", default="", metavar="REGEX", help="productions whose name matches, and no others")
    parser.add_argument("--processes", type=int, default=os.cpu_count(), help="default: %(default)s")
    parser.add_argument("--details", action="store_true", help="also print the counts of each case")
    asked = parser.parse_args()
    chosen = [
        case
        for case in cases(asked.share)
        if re.search(asked.only, case.estimate.__name__) and re.search(asked.of, case.production.name)
    ]
    with ProcessPoolExecutor(asked.processes) as pool:
        show(lines(chosen, partial(pool.map, chunksize=1), detailed=asked.details))


if __name__ == "__main__":
    main()
