"""The command: `python -m studies.c60_spread` prints the tables of studies/c60_spread/README.md."""

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
from studies.c60_spread.runs import clearances, run, shipped
from studies.c60_spread.tables import HEAD, Responses, mean_table, row, sigma_table
from studies.c60_spread.variants import SHIPPED, Variant, variants


def lines(chosen: list[Variant], count: int, mapped: Callable[..., Iterable[dict[str, float]]] = map) -> Iterator[str]:
    """Yield the lines of the tables of some variants; ``mapped`` is `map` or a parallel substitute for the samples."""
    began = time.monotonic()
    results: dict[str, Responses] = {}
    yield HEAD
    for variant in chosen:
        drawn = clearances(variant, count)
        samples = range(0, count, variant.fewer)
        gaps = [{joint: float(x[i]) for joint, x in drawn.items()} for i in samples]
        results[variant.name] = list(mapped(partial(run, variant), samples, gaps))
        yield row(variant.name, results[variant.name])
    compared = {v.heading: results[v.name] for v in chosen if v.heading}
    if SHIPPED in results and compared:
        yield from ("", *sigma_table(results[SHIPPED], compared))
        yield from ("", *mean_table(results[SHIPPED], compared))
    yield (
        f"\nclearcap {clearcap_version()}, build {build_id()}, Python {platform.python_version()}: the first {count}"
        f" samples of the campaign c60, seed {shipped().seed}, in {(time.monotonic() - began) / 60:.1f} minutes."
    )


def main() -> None:
    """Run all variants, or the requested ones, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.c60_spread", description=__doc__)
    parser.add_argument("--samples", type=int, default=200, help="default: %(default)s")
    parser.add_argument("--only", default="", metavar="REGEX", help="variants whose name matches, and no others")
    asked = parser.parse_args()
    warm_up()
    chosen = [variant for variant in variants() if re.search(asked.only, variant.name)]
    with ProcessPoolExecutor() as pool:
        for line in lines(chosen, asked.samples, partial(pool.map, chunksize=5)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
