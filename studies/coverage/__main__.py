"""The command: `python -m studies.coverage` prints the coverage of each interval of the report."""

import argparse
import os
import platform
import re
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from campaign.row_build import clearcap_version
from studies.coverage.families import Case, Key, all_tallies, cases
from studies.coverage.limit_states import DESIGNED
from studies.coverage.outcomes import Tally
from studies.coverage.productions import JUDGED_SHAPES, JUMPS, LOTS, LOTS_IN_TURN, SHAPES, SIZES
from studies.coverage.rarities import AIMED
from studies.coverage.tables import details, faults, table


def lines(
    chosen: list[Case], mapped: Callable[..., Iterable[dict[Key, Tally]]] = map, *, detailed: bool = False
) -> Iterator[str]:
    """Yield the lines of the tables of some cases; ``mapped`` is `map` or a parallel substitute."""
    began = time.monotonic()
    tallies = all_tallies(chosen, mapped)
    for productions in (SHAPES, JUDGED_SHAPES, LOTS, JUMPS, LOTS_IN_TURN, AIMED, DESIGNED):
        if any(key[1] == production.name for key in tallies for production in productions):
            yield from (*table(tallies, productions), "")
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
        for line in lines(chosen, partial(pool.map, chunksize=1), detailed=asked.details):
            print(line, flush=True)


if __name__ == "__main__":
    main()
