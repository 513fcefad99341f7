"""The command: `python -m studies.trip_force` prints the tables of studies/trip_force/README.md."""

import argparse
import platform
import re
import time
from collections.abc import Iterator, Mapping, Sequence

from campaign.row_build import clearcap_version
from engine import warm_up
from engine.platform.build import build_id
from studies.trip_force.assumptions import MAPPED, Assumptions, grids
from studies.trip_force.runs import run
from studies.trip_force.tables import GRIDS, MAP, Tried, grid_row, map_rows, verdict


def lines(chosen: Mapping[str, Sequence[Assumptions]]) -> Iterator[str]:
    """Yield the lines of the tables of some grids: one of the sets of the grid `MAPPED`, and one of all grids."""
    began = time.monotonic()
    tried: dict[str, Tried] = {}
    rows = []
    for name, sets in chosen.items():
        tried[name] = [(assumed, run(assumed)) for assumed in sets]
        rows.append(grid_row(name, tried[name]))
    if MAPPED in tried:
        yield from (MAP, *map_rows(tried[MAPPED]), "")
    yield from (GRIDS, *rows)
    yield from ("", *verdict(tried))
    yield (
        f"\nclearcap {clearcap_version()}, build {build_id()}, Python {platform.python_version()}, in"
        f" {(time.monotonic() - began) / 60:.1f} minutes."
    )


def main() -> None:
    """Run all grids, or the requested ones, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.trip_force", description=__doc__)
    parser.add_argument("--only", default="", metavar="REGEX", help="grids whose name matches, and no others")
    asked = parser.parse_args()
    warm_up()
    for line in lines({name: sets for name, sets in grids().items() if re.search(asked.only, name)}):
        print(line, flush=True)


if __name__ == "__main__":
    main()
