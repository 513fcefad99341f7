"""How far parts are off their drawing, at the features that are: zones of places and tilts, and lobes.

They are hundredths of a millimetre, so that each is drawn with one size on the canvas, and the factor is said.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from clearcap.pictures.canvas import SketchCanvas
from clearcap.pictures.style import INK
from clearcap.pictures.view import start_rotation
from engine import Mechanism
from engine.arrays import Array
from reporting.spec import LegendEntry

WIDE, LONG = 13.0, 34.0  # half the width of a zone on the canvas, and half its length along an axis in the drawing
TILT = 0.3  # rad, of a wedge
ROUND, LOBE = 8.0, 2.5  # smallest radius of a lobed outline, and how far its lobes stand out
END_ON = 0.5  # of the length of an axis seen in the drawing: below it, its zone is a circle


@dataclass(frozen=True)
class OffDrawing:
    """A side of a joint, or a gear, that is, or may be, off its drawing."""

    name: str
    point: Array  # as drawn, in the world (3,)
    axis: Array  # (3,)
    off: float  # distance of the axis from its place, or the largest in its zone [length]
    tilt: float  # the same of its tilt [rad]
    lobes: tuple[int, float]  # their number, and their height [length]; zeros without


def off_drawing(mechanism: Mechanism) -> Iterator[OffDrawing]:
    """Yield the sides of joints, then the gears, that are off their drawing, in the order of the file."""
    sides = [(f"{name} {key}", getattr(joint, key)) for name, joint in mechanism.joints.items() for key in joint.SIDES]
    for name, pair in mechanism.couplings.items():
        sides += [(f"{name} gear {i}", gear) for i, gear in enumerate(getattr(pair, "gears", ()), 1)]
    for name, side in sides:
        deviation, form = getattr(side, "deviation", None), getattr(side, "lobes", None)
        off, tilt = (deviation.off, deviation.tilt) if deviation is not None else (0.0, 0.0)
        lobes = (form.number, form.height) if form is not None else (0, 0.0)
        if off or tilt or lobes[1]:
            turn = start_rotation(mechanism, side.body)
            point = mechanism.bodies[side.body].origin + turn @ np.array(side.point)
            yield OffDrawing(name, point, turn @ np.array(side.axis), abs(off), abs(tilt), lobes)


def draw_zones(drawing: SketchCanvas, mechanism: Mechanism, *, varied: bool) -> list[LegendEntry]:
    """Draw what is off the drawing, and return what the legend says; if `varied`, these are the ends of zones."""
    unit, legend = mechanism.unit("length"), []
    for each in off_drawing(mechanism):
        at, words, factors = drawing.on_canvas(each.point), [], []
        seen = drawing.view.project(each.axis) * [1.0, -1.0]
        length = float(np.linalg.norm(seen))
        along = seen / length if length > END_ON else None
        if each.off:
            drawing.stroke(_place(at, along), INK, "dashed")
            words.append(
                f"position zone {2 * each.off:.4g} {unit}" if varied else f"{each.off:.4g} {unit} off its place"
            )
            factors.append(WIDE / (each.off * drawing.scale))
        if each.tilt:
            for line in _wedge(at, along):
                drawing.stroke(line, INK, "dashed")
            words.append(f"tilt {'up to ' if varied else ''}{each.tilt:.4g} rad")
            factors.append(TILT / each.tilt)
        if each.lobes[1]:
            drawing.stroke(_lobed(at, each.lobes[0]), INK)
            words.append(f"{each.lobes[0]} lobes, {each.lobes[1]:.4g} {unit} high")
            factors.append(LOBE / (each.lobes[1] * drawing.scale))
        for text in (each.name, *words):
            drawing.name(at - np.array([0.0, WIDE]), np.array([0.0, -1.0]), text, INK)
        sizes = " and ".join(f"{float(f'{factor:.2g}'):g}" for factor in factors)
        legend.append(LegendEntry(each.name, "; ".join(words), f"drawn {sizes} times as large", INK))
    return legend


def _circle(at: Array, radius: float) -> Array:
    turn = np.linspace(0.0, 2 * np.pi, 49)[:, None]
    return np.asarray(at + radius * np.hstack([np.cos(turn), np.sin(turn)]))


def _place(at: Array, along: Array | None) -> Array:
    """Return the zone of an axis: a circle if the axis is seen from its end, else the sides of a cylinder."""
    if along is None:
        return _circle(at, WIDE)
    across = np.array([-along[1], along[0]])
    corners = [(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)]
    return np.array([at + a * LONG * along + b * WIDE * across for a, b in corners])


def _wedge(at: Array, along: Array | None) -> list[Array]:
    """Return the lines between which an axis may lie; seen from its end, the circle of a cone with its middle."""
    if along is None:
        middle = np.array([[-0.6 * WIDE, 0.0], [0.6 * WIDE, 0.0]])
        return [_circle(at, 0.6 * WIDE), at + middle]
    across = np.array([-along[1], along[0]])
    ways = [np.cos(TILT) * along + sign * np.sin(TILT) * across for sign in (1, -1)]
    return [np.array([at - LONG * way, at + LONG * way]) for way in ways]


def _lobed(at: Array, number: int) -> Array:
    turn = np.linspace(0.0, 2 * np.pi, 97)[:, None]
    radius = ROUND + LOBE * (1 + np.cos(number * turn)) / 2
    return np.asarray(at + radius * np.hstack([np.cos(turn), np.sin(turn)]))
