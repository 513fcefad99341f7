"""The tables of the study in Markdown: every set of the small grids, and the nearest miss of each grid."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from studies.trip_force.assumptions import Assumptions
from studies.trip_force.runs import THRESHOLDS, Push

FORCE, AT_PEAK, RELEASE = 1.87, 0.27, 0.42  # N, mm, mm: the paper's simulation; AT_PEAK is measured
SHIPPED_THRESHOLD = 0.1
NEAR = 0.2  # share of the force within which distances are compared
MATCH = 0.1  # largest deviation of a set that reproduces all three

Tried = Sequence[tuple[Assumptions, Push]]

MAP = """\
| latch friction | force, N | at the peak, mm | release, mm | release from 0.02 N, mm | release from 0.5 N, mm |
| --- | --- | --- | --- | --- | --- |"""
COLUMNS = (
    *("grid", "sets", "released", "force, N", "release, mm", f"release where the force is within {NEAR:.0%}, mm"),
    *("nearest: N, mm, mm", "off by", "its set"),
)
GRIDS = f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}"


class Miss(NamedTuple):
    """Deviation of a set from the three published numbers, with the force that defines touching."""

    deviation: float  # the largest of the three, relative to the published numbers
    threshold: float  # N
    assumed: Assumptions
    force: float
    at_peak: float
    release: float


def misses(tried: Tried, thresholds: Iterable[float] = THRESHOLDS) -> list[Miss]:
    """Return the deviations of each set for each definition of touching, the smallest first."""
    found = []
    for assumed, push in tried:
        for limit in thresholds:
            numbers = push.force, push.at_peak[limit], push.release[limit]
            if np.isfinite(numbers).all():
                off = max(abs(x / y - 1) for x, y in zip(numbers, (FORCE, AT_PEAK, RELEASE), strict=True))
                found.append(Miss(off, limit, assumed, *numbers))
    return sorted(found, key=lambda miss: miss.deviation)


def map_rows(tried: Tried) -> list[str]:
    """Return a line for each set of a grid that changes only the friction of the latch."""
    return [
        f"| {assumed.latch:g} | {push.force:.2f} | {push.at_peak[SHIPPED_THRESHOLD]:.3f} "
        f"| {push.release[SHIPPED_THRESHOLD]:.3f} | {push.release[0.02]:.3f} | {push.release[0.5]:.3f} |"
        for assumed, push in tried
    ]


def grid_row(name: str, tried: Tried) -> str:
    """Return the line of a grid: its ranges, and its nearest miss for any definition of touching."""
    pushes = [push for _, push in tried if np.isfinite(push.force)]
    forces = [push.force for push in pushes]
    near = [push.release[SHIPPED_THRESHOLD] for push in pushes if abs(push.force / FORCE - 1) < NEAR]
    cells = [name, len(tried), len(pushes), _span(forces, 2)]
    cells += [_span([push.release[SHIPPED_THRESHOLD] for push in pushes], 3), _span(near, 3)]
    nearest = next(iter(misses(tried)), None)
    cells += miss_cells(nearest) if nearest else ["", "", ""]
    return f"| {' | '.join(map(str, cells))} |"


def miss_cells(miss: Miss) -> list[str]:
    """Return the results of a set, their deviation from the published numbers, and the set."""
    return [
        f"{miss.force:.2f}, {miss.at_peak:.3f}, {miss.release:.3f}",
        f"{100 * miss.deviation:.0f} %",
        f"{miss.assumed.changes()}; touch at {miss.threshold:g} N",
    ]


def verdict(grids: Mapping[str, Tried]) -> list[str]:
    """Return lines on which sets give all three numbers, separately for published sets and for others."""
    # A set that is in several grids counts once.
    every = list({assumed: (assumed, push) for tried in grids.values() for assumed, push in tried}.values())
    lines = []
    for what, tried in (
        ("at the pin, with a latch of the public CAD", [x for x in every if x[0].published and not x[0].at_spot_face]),
        ("at the spot face, with such a latch", [x for x in every if x[0].published and x[0].at_spot_face]),
        ("at the pin, with turned faces and a public bump", [x for x in every if x[0].angle]),
        ("at the pin, with a deeper latch", [x for x in every if not (x[0].published or x[0].angle)]),
    ):
        matching = [miss for miss in misses(tried, (SHIPPED_THRESHOLD,)) if miss.deviation <= MATCH]
        lines.append(f"- {what}: {len(matching)} of {len(tried)} sets give all three within {MATCH:.0%}")
        lines += [f"    - {': '.join(miss_cells(miss)[::2])}" for miss in matching]
    return lines


def _span(x: Sequence[float], places: int) -> str:
    """Return the smallest and the largest of some numbers as text."""
    good = [value for value in x if np.isfinite(value)]
    return f"{min(good):.{places}f} to {max(good):.{places}f}" if good else "none"
