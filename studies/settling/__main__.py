"""The command: `python -m studies.settling` prints the tables of studies/settling/README.md."""

import argparse
import platform
import re
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from campaign.row_build import clearcap_version
from engine import warm_up
from engine.platform.build import build_id
from studies.c60_spread.runs import clearances, shipped
from studies.c60_spread.variants import SHIPPED, Variant
from studies.settling.settlings import CHOSEN, CONTINUED, HALVINGS, LIMIT, WINDOWS, Ending, Settling, run, settlings
from studies.settling.tables import COSTS, Endings, cost_row, distance_table, mean_table, scatter_table


def lines(chosen: list[Settling], count: int, mapped: Callable[..., Iterable[Ending]] = map) -> Iterator[str]:
    """Yield the lines of the tables of some settlings; ``mapped`` is `map` or a parallel substitute for the samples."""
    began = time.monotonic()
    drawn = clearances(Variant(SHIPPED), count)
    found: dict[str, Endings] = {}
    yield COSTS
    for settling in chosen:
        samples = range(0, count, settling.fewer)
        gaps = [{joint: float(x[i]) for joint, x in drawn.items()} for i in samples for _ in HALVINGS]
        runs = iter(mapped(partial(run, settling), gaps, list(HALVINGS) * len(samples)))
        found[settling.name] = {i: [next(runs) for _ in HALVINGS] for i in samples}
        yield cost_row(settling.name, found[settling.name])
    yield from ("", *scatter_table(found))
    yield from ("", *mean_table(found))
    if LIMIT in found:
        yield from ("", *distance_table(found, LIMIT, 2))
    if CHOSEN in found:
        yield from (
            "",
            *distance_table({n: x for n, x in found.items() if n in (CHOSEN, CONTINUED, *WINDOWS)}, CHOSEN, 0),
        )
    yield (
        f"\nclearcap {clearcap_version()}, build {build_id()}, Python {platform.python_version()}: the first {count}"
        f" samples of the campaign c60, seed {shipped().seed}, four lengths of steps, in"
        f" {(time.monotonic() - began) / 60:.1f} minutes."
    )


def main() -> None:
    """Run all settlings, or the requested ones, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.settling", description=__doc__)
    parser.add_argument("--samples", type=int, default=200, help="default: %(default)s")
    parser.add_argument("--only", default="", metavar="REGEX", help="settlings whose name matches, and no others")
    parser.add_argument("--processes", type=int, help="default: as many as there are cores")
    asked = parser.parse_args()
    warm_up()
    chosen = [settling for settling in settlings() if re.search(asked.only, settling.name)]
    with ProcessPoolExecutor(asked.processes) as pool:
        for line in lines(chosen, asked.samples, partial(pool.map, chunksize=4)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
