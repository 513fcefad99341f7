"""Search for a set of assumptions that gives the C-60's tripping force and both of its distances.

`python -m studies.trip_force` prints the tables of studies/trip_force.md.

The bench `trip_pin` is simulated with the clearances of the prototype, over grids of properties that no source gives:
friction of each contact, a spring on the tripping bar, side and guide of the pin, settling, depth of the latch, and the
way in which a distance is read. None of them is adopted in the mechanism.
"""

import argparse
import copy
import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import qmc

from engine import simulate, warm_up
from engine.mechanism import Mechanism
from engine.mechanism.models import mechanism_from
from studies import head, made_by, show
from studies.c60_spread import c60

LATCH = (0.01, 0.03, 0.06, 0.1, 0.2, 0.3)
ANGLES = (5.0, 9.0, 11.0, 12.0, 12.5, 13.0, 15.0)
PUBLISHED_BUMPS = (0.45, 0.47, 0.48, 0.499)  # mm: radii of the public CAD; with 0.5 the bump overlaps the hook's nose
BENCHES = ("trip_pin", "trip_lamage")
DRAWN = 128  # number of sets drawn from the box
MAPPED = "friction of the latch"  # the grid whose sets have a table of their own


@dataclass(frozen=True)
class Assumptions:
    """One set of assumptions; the defaults are the shipped values."""

    latch: float = 0.3  # friction, C4
    bump: float = 0.3  # friction of the bar's bump on the hook, C5
    bar: float = 0.3  # friction of the bar on its pin, J4
    pin: float = 0.1  # friction of the testing pin in its hole
    flanges: float = 0.3  # friction of the stops along the axes
    plastics: float = 0.3  # friction of all other contacts of plastic on plastic
    steel: float = 0.1  # and of steel on plastic
    torque: float = 0.0  # closing, of a spring on the tripping bar [N mm]
    stiffness: float = 0.0  # increase of the closing torque per rad of opening of the bar relative to the plate [N mm]
    preload: float = 0.9599  # of A3 [rad]; with the shipped value the contact force of the paper's other test agrees
    bump_radius: float = 0.48  # [mm]; a smaller radius gives a deeper latch
    angle: float = 0.0  # of the latch's faces [degrees]
    bench: str = "trip_pin"  # place where the pin pushes: ``trip_pin`` in its hole, ``trip_lamage`` at the spot face
    held: bool = False  # the pin is guided laterally and does not give way
    preset: str = ""  # for the settling before the test; the shipped drag if empty

    @property
    def published(self) -> bool:
        """Whether the latch is one of the public CAD variants, in depth and in the angle of its faces."""
        return self.bump_radius in PUBLISHED_BUMPS and not self.angle

    @property
    def at_spot_face(self) -> bool:
        """Whether the pin pushes at the spot face, and not in its hole as in the paper."""
        return self.bench == "trip_lamage"

    def changes(self) -> str:
        """Return the differences from the shipped values as text for a table."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        changed = {name: value for name, value in own.items() if value != getattr(SHIPPED, name)}
        told = (f"{name} {x:.3g}" if isinstance(x, float) else f"{name} {x}" for name, x in changed.items())
        return ", ".join(told).replace("held True", "held across") or "as shipped"


SHIPPED = Assumptions()


def grids() -> dict[str, list[Assumptions]]:
    """Return the sets of each grid, by its name in the tables."""
    return {
        MAPPED: [replace(SHIPPED, latch=mu) for mu in LATCH],
        "friction of latch, bar, pin": _of(latch=LATCH, bar=(0.0, 0.1, 0.3), pin=(0.0, 0.3)),
        "one friction everywhere": [_everywhere(mu) for mu in LATCH],
        "latch, and one friction of all others": list(_others()),
        "spring on the bar": _of(latch=LATCH[:4], torque=(1.5, 3.0, 6.0), stiffness=(0.0, 30.0)),
        "radius of the bump, public": _of(latch=(0.03, 0.06, 0.1), torque=(0.0, 3.0), bump_radius=PUBLISHED_BUMPS),
        "side and guide of the pin": _of(latch=LATCH, bench=BENCHES, held=(False, True)),
        "spot face": _of(latch=(0.035, 0.04, 0.045, 0.05), bar=(0.1, 0.3), pin=(0.0, 0.1), bench=("trip_lamage",)),
        "settling": _of(latch=LATCH, preset=("paper", "centred")),
        "preload of A3": _of(latch=LATCH, preload=(0.49, 0.6547)),
        "angle of the latch's faces": _of(angle=ANGLES, bump_radius=(0.48, 0.45)),
        "anything in the box": list(box(DRAWN)),
        "a deeper latch than any published": list(deeper()),
    }


def deeper() -> Iterator[Assumptions]:
    """Yield sets with a bump smaller than any published one."""
    yield from _of(latch=(0.01, 0.03, 0.06), torque=(0.0, 1.0, 2.0, 3.0), bump_radius=(0.3, 0.35))


def box(count: int) -> Iterator[Assumptions]:
    """Yield sets of a scrambled Sobol' sequence (seed 2018): every friction, a spring, a public bump, either side."""
    # Friction of the latch is from 0.01 to 0.1, because more requires too much force; all others are from 0.03 to 0.3.
    names = ("latch", "bump", "bar", "pin", "flanges", "plastics", "steel")
    for u in qmc.Sobol(len(names) + 4, rng=np.random.default_rng(2018)).random(count):
        least = {"latch": 0.01}
        friction: dict[str, Any] = {name: float(least.get(name, 0.03) * 10 ** u[i]) for i, name in enumerate(names)}
        yield replace(
            SHIPPED,
            **friction,
            torque=float(4 * u[-4]),
            stiffness=float(30 * u[-3]),
            bump_radius=PUBLISHED_BUMPS[int(len(PUBLISHED_BUMPS) * u[-2])],
            bench=BENCHES[int(len(BENCHES) * u[-1])],
        )


def _of(**values: tuple[float | str | bool, ...]) -> list[Assumptions]:
    """Return the sets with every combination of the given values."""
    return [replace(SHIPPED, **dict(zip(values, chosen, strict=True))) for chosen in product(*values.values())]  # type: ignore[arg-type]


def _everywhere(mu: float) -> Assumptions:
    return replace(SHIPPED, latch=mu, bump=mu, bar=mu, pin=mu, flanges=mu, plastics=mu, steel=mu)


def _others() -> Iterator[Assumptions]:
    """Yield sets with one friction for the latch and another for all other contacts."""
    for latch, mu in product(LATCH, (0.03, 0.1)):
        yield replace(_everywhere(mu), latch=latch)


THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.5)  # N: forces at which the pin is considered to touch; the bench uses 0.1
GROUPS = {"latch": ("C4",), "bump": ("C5",), "flanges": ("S1", "S2", "S4", "Sx", "S5", "S12", "S11", "S8", "S7")}
FRICTION = {"latch", "bump", "bar", "pin", "flanges"}
NO_TORQUE = 1e-9  # N mm: keeps the spring in the mechanism, so that its structure is compiled only once


class Push(NamedTuple):
    """Result of a test of the tripping force."""

    status: str
    force: float  # N: largest force before release
    at_peak: dict[float, float]  # mm from touching to the largest force, by the force that defines touching
    release: dict[float, float]  # mm from touching to release


def run(assumed: Assumptions) -> Push:
    """Return the result with a set of assumptions; NaN if the latch did not hold or never released."""
    mechanism = bench(assumed.bench, assumed.held)
    shipped = c60()
    presets = shipped.preset("prototype") | (shipped.preset(assumed.preset) if assumed.preset else {})
    # Of the presets only the settling is taken: the steps stay those of the bench.
    values = {key: x for key, x in presets.items() if not key.startswith("simulation.")} | {
        **{f"materials.{name}.friction": getattr(assumed, name) for name in FRICTION},
        "materials.plastic_plastic.friction": assumed.plastics,
        "materials.steel_plastic.friction": assumed.steel,
        "torques.bar_return.torque.z": -max(assumed.torque, NO_TORQUE),
        "springs.bar_return.stiffness": max(assumed.stiffness, NO_TORQUE),
        "springs.A3.preload": assumed.preload,
        **{f"contacts.C5_{i}.a.arc.radius": assumed.bump_radius for i in (1, 2)},
        "parameters.latch_angle": np.radians(assumed.angle),
    }
    found = simulate(mechanism, values)
    measured = found.responses
    touches = {limit: measured.get(_name(limit), np.nan) for limit in THRESHOLDS}
    return Push(
        found.status,
        measured.get("peak_force", np.nan),
        {limit: measured.get("way_at_peak", np.nan) - touch for limit, touch in touches.items()},
        {limit: measured.get("way", np.nan) - touch for limit, touch in touches.items()},
    )


@lru_cache(maxsize=4)
def bench(name: str, held: bool) -> Mechanism:
    """Return a bench of the C-60 with a material for each group of contacts, and a spring on the tripping bar."""
    data = c60(name).model_dump(by_alias=True, exclude_unset=True)
    data["materials"] |= {group: {"friction": 0.3, "restitution": 0.0} for group in FRICTION}
    for contact, table in data["contacts"].items():
        for group, stops in GROUPS.items():
            if contact.split("_")[0] in stops:
                table["material"] = group
    data["joints"]["J4"]["material"] = "bar"
    data["joints"]["hole"]["material"] = "pin"
    bodies = data["bodies"]
    data["springs"]["bar_return"] = {
        "type": "torsion",
        "a": "plate",
        "b": "tripping_bar",
        "axis": [0.0, 0.0, 1.0],
        "stiffness": NO_TORQUE,
        "free_angle": bodies["tripping_bar"]["angle"] - bodies["plate"]["angle"],
    }
    data["torques"]["bar_return"] = {"body": "tripping_bar", "torque": [0.0, 0.0, -NO_TORQUE], "frame": "world"}
    for limit in THRESHOLDS:
        touch = copy.deepcopy(data["responses"]["touch"])
        touch["at"]["above"] = limit
        data["responses"][_name(limit)] = touch
    if held:
        _hold(data)
    return mechanism_from(data, f"{name}, held" if held else name)


def _hold(data: dict[str, Any]) -> None:
    """Guide the pin along Y while it pushes, instead of a guide that allows it to give way laterally."""
    push = data["motions"]["push"]
    data["motions"]["across"] = push | {"along": {"direction": [1.0, 0.0, 0.0]}, "law": {"speed": 0.0}}


def _name(limit: float) -> str:
    return f"touch_at_{limit:g}".replace(".", "_")


FORCE, AT_PEAK, RELEASE = 1.87, 0.27, 0.42  # N, mm, mm: the paper's simulation; AT_PEAK is measured
SHIPPED_THRESHOLD = 0.1
NEAR = 0.2  # share of the force within which distances are compared
MATCH = 0.1  # largest deviation of a set that reproduces all three

Tried = Sequence[tuple[Assumptions, Push]]

_RELEASES = ("release, mm", "release from 0.02 N, mm", "release from 0.5 N, mm")
MAP = head("latch friction", "force, N", "at the peak, mm", *_RELEASES)
GRIDS = head(
    *("grid", "sets", "released", "force, N", "release, mm", f"release where the force is within {NEAR:.0%}, mm"),
    *("nearest: N, mm, mm", "off by", "its set"),
)


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
    yield made_by(began)


def main() -> None:
    """Run all grids, or the requested ones, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.trip_force", description=__doc__)
    parser.add_argument("--only", default="", metavar="REGEX", help="grids whose name matches, and no others")
    asked = parser.parse_args()
    warm_up()
    show(lines({name: sets for name, sets in grids().items() if re.search(asked.only, name)}))


if __name__ == "__main__":
    main()
