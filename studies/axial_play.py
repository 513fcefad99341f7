"""Effect of the play of the C-60's parts along their axes on its responses: `python -m studies.axial_play`.

It prints the table of studies/axial_play.md. The drawings define the play of the parts between case and cover, but not
their positions in it. Each variant starts the same samples at other positions, or gives them more play than drawn.
Nothing is fitted.
"""

import argparse
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from engine import simulate, warm_up
from engine.mechanism import get_value
from studies import head, made_by, show
from studies.c60_spread import FEWEST, Responses, c60, column, gaps_of_samples, interval, mean, shipped, sigma

SHIPPED = "on the lower shoulders: as shipped"
CENTRED = "in the middle: preset centred"
COVER = 0.1, 0.24, 0.3  # mm: free path of plate, hook and tripping bar to the cover when all rest on their shoulders
FLANGES = ("S4", "S5", "S7", "S8")  # those with a gap of 0 in the published pose
WAYS = 0.05, 0.1, 0.2  # mm
WIDEST = 0.3  # mm

LENGTHS = ("FC-4", "FC-5", "FC-6")
COLUMNS = ("start", "settling", "ok", "FC-1 mean, N", "sigma, N", "95 % of sigma", "FC-1_high - FC-1_low, N")
HEAD = head(*COLUMNS, *(f"{name} mean, mm" for name in LENGTHS))
SETTLINGS = (("drag", False), ("free fall", True))

Drawn = Literal["random"] | tuple[float, float, float, float]
LIFTED = ("moving_contact", "plate", "hook", "tripping_bar")


@dataclass(frozen=True)
class Play:
    """A start along the axes."""

    name: str  # row of the table
    # Heights of moving contact, plate, hook and tripping bar above the published pose at the start [mm]; "random":
    # anywhere within the drawn stops, at a different place in each sample.
    lifts: Drawn = (0.0, 0.0, 0.0, 0.0)
    # Additional play of each flange beyond the drawn one [mm]; "random": between 0 and 0.3 mm, drawn for each sample.
    opened: dict[str, float] | Literal["random"] | None = None
    preset: str | None = None  # of the mechanism that sets the start positions
    free_fall: bool = False  # also simulated with preset paper, whose free fall takes longer than the shipped drag


def plays() -> list[Play]:
    """Return the compared variants, the shipped start first."""
    top, hook, bar = COVER
    return [
        Play(SHIPPED, free_fall=True),
        Play(CENTRED, preset="centred", free_fall=True),
        Play("under the cover", (top, top, hook, bar), free_fall=True),
        Play("anywhere in the drawn play", "random", free_fall=True),
        *(Play(f"{flange} opened by 0.1 mm", opened={flange: 0.1}) for flange in FLANGES),
        *(Play(f"S7 and S8 opened by {x:g} mm", opened={"S7": x, "S8": x}, free_fall=x == 0.1) for x in WAYS),
        *(Play(f"all four opened by {x:g} mm", opened=dict.fromkeys(FLANGES, x)) for x in WAYS),
        Play("all four opened by 0 to 0.3 mm", opened="random"),
    ]


def run(play: Play, free_fall: bool, sample: int, gaps: Mapping[str, float]) -> dict[str, float]:
    """Return the responses of one sample with its clearances (mm by joint); empty unless the run is ok."""
    values = c60().preset("paper") if free_fall else {}
    found = simulate(c60(), values | starts(play, sample) | dict(gaps))
    return found.responses if found.status == "ok" else {}


def starts(play: Play, sample: int) -> dict[str, float]:
    """Return the numbers of the mechanism that differ from the published ones in a sample, by their keys."""
    # A sample draws the same numbers in every variant, so that its runs can be compared one by one.
    rng = np.random.default_rng([shipped().seed, sample])
    values = dict(c60().preset(play.preset)) if play.preset else {}
    lifts = _anywhere(rng) if play.lifts == "random" else play.lifts
    for body, lift in zip(LIFTED, lifts, strict=True):
        if lift:
            key = f"bodies.{body}.origin.z"
            values[key] = get_value(c60(), key) + lift
    opened = dict(zip(FLANGES, rng.uniform(0, WIDEST, 4), strict=True)) if play.opened == "random" else play.opened
    for flange, way in (opened or {}).items():
        for i in (1, 2, 3):
            key = f"contacts.{flange}_{i}.b.plane.point.z"
            values[key] = get_value(c60(), key) - float(way)
    return values


def _anywhere(rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Return random positions, uniform over those that the drawn stops permit."""
    top, hook, bar = COVER
    contact, plate = np.sort(rng.uniform(0, top, 2))
    return float(contact), float(plate), float(rng.uniform(plate, hook)), float(rng.uniform(plate, bar))


def lines(chosen: list[Play], count: int) -> Iterator[str]:
    """Yield the lines of the table, computed with the first samples of the campaign."""
    began, gaps = time.monotonic(), gaps_of_samples(count)
    yield HEAD
    for play in chosen:
        for settling, free_fall in SETTLINGS[: 1 + play.free_fall]:
            yield row(f"{play.name} | {settling}", [run(play, free_fall, i, drawn) for i, drawn in gaps.items()])
    yield made_by(began, f": the first {count} samples of the campaign c60, seed {shipped().seed}")


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
    show(lines(plays(), asked.samples))


if __name__ == "__main__":
    main()
