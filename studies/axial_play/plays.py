"""Start positions of the C-60's parts along their axes and their play there, and the responses of a run with them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from engine import load_mechanism, simulate
from engine.mechanism import Mechanism, get_value
from studies.c60_spread.runs import shipped

SHIPPED = "on the lower shoulders: as shipped"
CENTRED = "in the middle: preset centred"
COVER = 0.1, 0.24, 0.3  # mm: free path of plate, hook and tripping bar to the cover when all rest on their shoulders
FLANGES = ("S4", "S5", "S7", "S8")  # those with a gap of 0 in the published pose
WAYS = 0.05, 0.1, 0.2  # mm
WIDEST = 0.3  # mm

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
    values = _c60().preset("paper") if free_fall else {}
    found = simulate(_c60(), values | starts(play, sample) | dict(gaps))
    return found.responses if found.status == "ok" else {}


def starts(play: Play, sample: int) -> dict[str, float]:
    """Return the numbers of the mechanism that differ from the published ones in a sample, by their keys."""
    # A sample draws the same numbers in every variant, so that its runs can be compared one by one.
    rng = np.random.default_rng([shipped().seed, sample])
    values = dict(_c60().preset(play.preset)) if play.preset else {}
    lifts = _anywhere(rng) if play.lifts == "random" else play.lifts
    for body, lift in zip(LIFTED, lifts, strict=True):
        if lift:
            key = f"bodies.{body}.origin.z"
            values[key] = get_value(_c60(), key) + lift
    opened = dict(zip(FLANGES, rng.uniform(0, WIDEST, 4), strict=True)) if play.opened == "random" else play.opened
    for flange, way in (opened or {}).items():
        for i in (1, 2, 3):
            key = f"contacts.{flange}_{i}.b.plane.point.z"
            values[key] = get_value(_c60(), key) - float(way)
    return values


def _anywhere(rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Return random positions, uniform over those that the drawn stops permit."""
    top, hook, bar = COVER
    contact, plate = np.sort(rng.uniform(0, top, 2))
    return float(contact), float(plate), float(rng.uniform(plate, hook)), float(rng.uniform(plate, bar))


@lru_cache(maxsize=1)
def _c60() -> Mechanism:
    """Return the C-60; cached, because reading its file takes longer than some runs."""
    return load_mechanism("c60")
