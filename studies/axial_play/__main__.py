"""The command: `python -m studies.axial_play` prints the table of studies/axial_play/README.md."""

import argparse
import platform
import time
from collections.abc import Iterator

import numpy as np

from campaign.row_build import clearcap_version
from engine import warm_up
from engine.platform.build import build_id
from studies.axial_play.plays import Play, plays, run
from studies.c60_spread.runs import clearances, shipped
from studies.c60_spread.tables import FEWEST, Responses, column, interval, mean, sigma
from studies.c60_spread.variants import SHIPPED, Variant

LENGTHS = ("FC-4", "FC-5", "FC-6")
COLUMNS = (
    *("start", "settling", "ok", "FC-1 mean, N", "sigma, N", "95 % of sigma", "FC-1_high - FC-1_low, N"),
    *(f"{name} mean, mm" for name in LENGTHS),
)
HEAD = f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}"
SETTLINGS = (("drag", False), ("free fall", True))


def lines(chosen: list[Play], count: int) -> Iterator[str]:
    """Yield the lines of the table, computed with the first samples of the campaign."""
    began = time.monotonic()
    drawn = clearances(Variant(SHIPPED), count)
    gaps = [{joint: float(x[i]) for joint, x in drawn.items()} for i in range(count)]
    yield HEAD
    for play in chosen:
        for settling, free_fall in SETTLINGS[: 1 + play.free_fall]:
            yield row(f"{play.name} | {settling}", [run(play, free_fall, i, gaps[i]) for i in range(count)])
    yield (
        f"\nclearcap {clearcap_version()}, build {build_id()}, Python {platform.python_version()}: the first {count}"
        f" samples of the campaign c60, seed {shipped().seed}, in {(time.monotonic() - began) / 60:.1f} minutes."
    )


def row(name: str, results: Responses) -> str:
    """Return a line of the table."""
    found = {name: column(results, name) for name in ("FC-1", "FC-1_low", "FC-1_high", *LENGTHS)}
    good = np.isfinite(found["FC-1"])
    found = {name: x[good] for name, x in found.items()}
    ok = f"{np.count_nonzero(good)} of {good.size}"
    if found["FC-1"].size < FEWEST:
        return f"| {name} | {ok} | | | | | | | |"
    low, high = interval(sigma, found["FC-1"])
    band = mean(found["FC-1_high"] - found["FC-1_low"])
    return (
        f"| {name} | {ok} | {mean(found['FC-1']):.2f} | {sigma(found['FC-1']):.3f} | {low:.3f} to {high:.3f} "
        f"| {band:.3f} | {' | '.join(f'{mean(found[name]):.3f}' for name in LENGTHS)} |"
    )


def main() -> None:
    """Run all starts and print the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.axial_play", description=__doc__)
    parser.add_argument("--samples", type=int, default=200, help="default: %(default)s")
    asked = parser.parse_args()
    warm_up()
    for line in lines(plays(), asked.samples):
        print(line, flush=True)


if __name__ == "__main__":
    main()
