"""Start positions of the C-60's parts along their axes, and their play there."""

from dataclasses import dataclass
from typing import Literal

SHIPPED = "on the lower shoulders: as shipped"
CENTRED = "in the middle: preset centred"
COVER = 0.1, 0.24, 0.3  # mm: free path of plate, hook and tripping bar to the cover when all rest on their shoulders
FLANGES = ("S4", "S5", "S7", "S8")  # those with a gap of 0 in the published pose
WAYS = 0.05, 0.1, 0.2  # mm
WIDEST = 0.3  # mm

Drawn = Literal["random"] | tuple[float, float, float, float]


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
