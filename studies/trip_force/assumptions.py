"""The study's assumptions on properties that no source gives: grids, and sets drawn from a box."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Any

import numpy as np
from scipy.stats import qmc

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
        return (
            ", ".join(_told(self, field.name) for field in fields(self) if _differs(self, field.name)) or "as shipped"
        )


def _differs(assumed: Assumptions, name: str) -> bool:
    return bool(getattr(assumed, name) != getattr(SHIPPED, name))


def _told(assumed: Assumptions, name: str) -> str:
    value = getattr(assumed, name)
    return f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}".replace("held True", "held across")


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
    """Yield sets of a scrambled Sobol' sequence (seed 2018): every friction, a spring, a public bump, either side.

    Friction of the latch is from 0.01 to 0.1, because more requires too much force; all others are from 0.03 to 0.3.
    """
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
