"""A run as a drawing that a page animates: every outline once, and its position in each frame."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from clearcap.pictures.play import Play
from clearcap.pictures.scene import CUT, HOLD, PER_SECOND, TRAIL, BodyFrames, Scene, zigzag
from engine.arrays import Array

LARGER_SIDE = 1000.0  # of the drawing, in its own units; coordinates have one decimal
HEAD = 12.0  # length of an arrow's head
TURN_DECIMALS, PLAY_DECIMALS = 6, 3


@dataclass(frozen=True)
class BodyDrawing:
    """A body at the last frame."""

    name: str
    colour: str  # as written in SVG
    is_fixed: bool  # it is ground
    is_rod: bool  # its outline is a line
    parts: dict[str, str]  # SVG paths of ``outline``, ``lines``, ``faces`` and ``joints``; empty if there is none
    label: list[float]  # position of its name


@dataclass(frozen=True)
class MovingDrawing:
    """A run as a drawing with y downwards; it shows the last frame until a page animates it.

    ``frames`` has the data of m frames: ``time`` (m), ``springs`` and ``arrows`` (m paths each); ``bodies``, each with
    ``parts`` (polylines ``x, y, z, x, ...`` in the body's frame), ``middle``, and ``places`` (m lists ``a b c d e f g
    h``: a point is drawn at ``a x + b y + c z + g, d x + e y + f z + h``); ``plays``, for each ring the m positions of
    the axis in clearances; and the numbers of frames per ``second``, of a ``trail``, and of the ``hold`` at the end.
    """

    width: float  # the larger of width and height is 1000 (`LARGER_SIDE`)
    height: float
    unit: str  # of time
    length_unit: str  # of length
    bodies: list[BodyDrawing]  # at the last frame
    springs: str  # path data of all springs
    arrows: str  # path data of all contact forces
    common: str  # a force, as text; empty without forces
    key: str  # path of the arrow of that force
    key_length: float  # length of that arrow
    cut: float  # multiple of that length at which longer arrows are cut
    # Each with ``joint``, ``clearance``, and ``rings``: paths of a journal's ``trail`` and ``dot``.
    plays: list[dict[str, Any]]
    frames: dict[str, Any]


def moving_drawing(scene: Scene) -> MovingDrawing:
    """Return the drawing of a scene."""
    low, high = scene.corners
    scale = LARGER_SIDE / float(np.max(high - low))
    corner = np.array([low[0], high[1]])  # upper left

    def drawn(points: Array) -> Array:
        return np.asarray((points - corner) * [scale, -scale])

    bodies = {name: _moved(body, scale, corner) for name, body in scene.bodies.items()}
    plays, count = [_rings(play, scene) for play in scene.plays], len(scene.time)
    springs = [path_data(drawn(zigzag(*ends[i])) for ends in scene.springs) for i in range(count)]
    forces = [arrow_data(drawn(scene.points[i]), drawn(scene.points[i] + scene.arrows[i])) for i in range(count)]
    return MovingDrawing(
        width=round(scale * float(high[0] - low[0]), 1),
        height=round(scale * float(high[1] - low[1]), 1),
        unit=scene.units["time"],
        length_unit=scene.units["length"],
        bodies=[_at_the_end(name, scene.colours[name], body, bodies[name]) for name, body in scene.bodies.items()],
        springs=springs[-1],
        arrows=forces[-1],
        common=f"{scene.common:g} {scene.units['force']}" if scene.common else "",
        key=arrow_data(np.zeros((1, 2)), np.array([[scale * scene.long, 0.0]])) if scene.common else "",
        key_length=round(scale * scene.long, 1),
        cut=CUT,
        plays=[
            {"joint": play.joint, "clearance": play.clearance, "rings": [_ring_at_the_end(places) for places in rings]}
            for play, rings in zip(scene.plays, plays, strict=True)
        ],
        frames={
            "time": [float(f"{time:.6g}") for time in scene.time],
            "springs": springs,
            "arrows": forces,
            "bodies": list(bodies.values()),
            "plays": plays,
            "second": PER_SECOND,
            "trail": TRAIL,
            "hold": HOLD,
        },
    )


def path_data(polylines: Iterable[Array], *, closed: bool = False) -> str:
    """Return polylines, each of shape (k, 2), as the data of one SVG path; a single point becomes a dot."""
    texts = []
    for line in polylines:
        points = [f"{x:.1f} {y:.1f}" for x, y in line]
        rest = "L".join(points[1:]) or points[0]
        texts.append(f"M{points[0]}L{rest}{'Z' if closed else ''}")
    return "".join(texts)


def arrow_data(starts: Array, ends: Array) -> str:
    """Return arrows with their heads as the data of one SVG path; arrows shorter than one unit are left out."""
    lengths = np.linalg.norm(ends - starts, axis=1)
    starts, ends, lengths = (each[lengths > 1.0] for each in (starts, ends, lengths))
    back = (starts - ends) * np.minimum(HEAD / lengths, 0.4)[:, None]  # of a short arrow, the head takes 0.4
    across = 0.5 * back[:, ::-1] * [1.0, -1.0]
    heads = np.stack([ends + back + across, ends, ends + back - across], axis=1)
    return path_data([*np.stack([starts, ends], axis=1), *heads])


def _moved(body: BodyFrames, scale: float, corner: Array) -> dict[str, Any]:
    turn = body.turn * np.array([1.0, -1.0])[:, None]
    places = np.hstack([turn.reshape(-1, 6).round(TURN_DECIMALS), ((body.origin - corner) * [scale, -scale]).round(1)])
    shape = body.shape
    outline = [] if body.fixed or not len(shape.outline) else [shape.outline]
    joints = [point[None] for point in shape.joints]
    parts = {"outline": outline, "lines": shape.lines, "faces": shape.faces, "joints": joints}
    middle = scale * shape.outline.mean(axis=0) if len(shape.outline) else np.zeros(3)
    return {
        "parts": {part: [(scale * line).round(1).ravel().tolist() for line in lines] for part, lines in parts.items()},
        "middle": middle.round(1).tolist(),
        "places": places.tolist(),
    }


def _at_the_end(name: str, colour: str, body: BodyFrames, moved: dict[str, Any]) -> BodyDrawing:
    place = np.array(moved["places"][-1])

    def drawn(numbers: list[float]) -> Array:
        return np.asarray(np.reshape(numbers, (-1, 3)) @ place[:6].reshape(2, 3).T + place[6:])

    parts = {part: path_data(map(drawn, lines), closed=part == "outline") for part, lines in moved["parts"].items()}
    label = drawn(moved["middle"])[0].round(1).tolist()
    return BodyDrawing(name, colour, body.fixed, len(body.shape.outline) == 2, parts, label)


def _rings(play: Play, scene: Scene) -> list[list[list[float]]]:
    points = (play.eccentricity[scene.rows] * [1.0, -1.0]).round(PLAY_DECIMALS)
    return [points[:, ring].tolist() for ring in range(points.shape[1])]


def _ring_at_the_end(places: list[list[float]]) -> dict[str, str]:
    points = [f"{x:g} {y:g}" for x, y in places[-TRAIL - 1 :]]
    return {"trail": f"M{'L'.join(points)}", "dot": f"M{points[-1]}h0"}
