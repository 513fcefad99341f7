"""The runs of the study: the numbers of the mechanism that a variant changes, and the responses of a run."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from engine import load_mechanism, simulate
from engine.mechanism import Mechanism, get_value
from studies.axial_play.plays import COVER, FLANGES, WIDEST, Play
from studies.c60_spread.runs import shipped

LIFTED = ("moving_contact", "plate", "hook", "tripping_bar")


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
