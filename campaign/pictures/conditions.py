"""What a mechanism's responses measure: lengths, gaps and contact forces as arrows on it, at its start pose."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from campaign.pictures.curves import file_metadata
from campaign.pictures.parts import part_of
from campaign.pictures.stage import joined
from campaign.pictures.style import FORCE, INK, MUTED, PALETTE, STYLE, bare
from campaign.pictures.view import Array, View, choose_view, start_rotation
from engine import Mechanism

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE, DPI = (9.0, 6.2), 100
LEVEL = 0.07  # between arrows that start at one point along one direction, in sizes of the mechanism
FORCE_ARROW = 0.12  # length of the arrow of a force, in sizes of the mechanism
SHORT = 0.03  # a length smaller than this share of the mechanism is marked by an arrow from outside
ALONG_SIGHT = 0.3  # what is seen of a unit vector, from which on it is drawn

Contacts = dict[str, tuple[float, Array, Array, str]]  # by name: gap, point, normal, the body that is pushed along it


@dataclass(frozen=True)
class Measure:
    """A response as drawn.

    Attributes
    ----------
    name, title : of the response
    force : whether it is the force at ``start``, else the length from ``start`` to ``end``
    start, end : (3,) in the world; the arrow from one to the other points in the positive direction
    point : (3,) the measured point, beside one of them or at it
    value : at the start pose, with its unit; of a force the body it acts on
    """

    name: str
    title: str
    force: bool
    start: Array
    end: Array
    point: Array
    value: str


def measures(mechanism: Mechanism, contacts: Contacts) -> Iterator[Measure]:
    """Yield the responses that are lengths, gaps or contact forces, at the start pose; `contacts_at_start` there."""
    for name, response in mechanism.responses.items():
        if response.type == "position":
            yield _length(mechanism, name, response)
        elif response.type == "gap" and response.contact in contacts:
            gap, point, way, _ = contacts[response.contact]
            yield Measure(name, response.title, False, point, point + gap * way, point, _text(mechanism, gap))
        elif response.type == "contact_force" and response.contact in contacts and response.bound is None:
            _, point, way, body = contacts[response.contact]
            yield Measure(name, response.title, True, point, point + way, point, f"on {body}")


def plot_conditions(mechanism: Mechanism, path: Path) -> None:
    """Write the mechanism as its file has it, with what its responses measure; ``.png``, ``.svg`` or ``.pdf``."""
    import matplotlib
    from matplotlib.figure import Figure

    view = choose_view(mechanism)
    contacts = contacts_at_start(mechanism)
    found = list(measures(mechanism, contacts))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=SIZE)
        figure.suptitle(f"{mechanism.title or mechanism.name}: what is measured", x=0.02, ha="left", fontsize=10)
        axes = figure.add_axes((0.02, 0.03, 0.68, 0.9))
        bare(axes)
        size = _draw_bodies(axes, mechanism, view, contacts)
        levels: dict[tuple[float, ...], int] = {}
        for i, measure in enumerate(found):
            colour = FORCE if measure.force else PALETTE[i % len(PALETTE)]
            _draw_measure(axes, measure, view, size, colour, levels)
            _explain(figure, measure, colour, 0.9 - i * min(0.075, 0.85 / len(found)))
        figure.savefig(path, dpi=DPI, metadata=file_metadata(path.suffix, described(mechanism, found)))


def described(mechanism: Mechanism, found: list[Measure]) -> str:
    """Return in words what the picture shows."""
    listed = "; ".join(f"{m.name}: {m.title}, {m.value}" for m in found)
    return f"{mechanism.title or mechanism.name} at its start, with arrows for what is measured. {listed}."


def _length(mechanism: Mechanism, name: str, response: Any) -> Measure:
    """Return a position: from a point, or from the foot of the measured point on an axis, along a direction."""
    start, way = response.from_, response.direction
    turn = start_rotation(mechanism, way.body) if way.body else np.eye(3)
    direction = turn @ way.vector
    to = _world(mechanism, response.to.body, response.to.point)
    if start.axis is None:
        begin = _world(mechanism, start.body, start.point)
    else:
        begin, axis = (
            _world(mechanism, start.body, start.axis.point),
            start_rotation(mechanism, start.body) @ start.axis.axis,
        )
        begin = begin + (to - begin) @ axis * axis
    value = float(direction @ (to - begin)) + response.offset
    end = begin + value * direction
    first, last = (begin, end) if value >= 0 else (end, begin)
    return Measure(name, response.title, False, first, last, to, _text(mechanism, value))


def contacts_at_start(mechanism: Mechanism) -> Contacts:
    """Return gap and point of each contact, the normal of the force on its first body that moves, and that body."""
    from engine.assembly import assemble
    from engine.assembly.frames import order_bodies
    from engine.kernels.gaps import find_contacts

    assembly = assemble(mechanism)
    state, work, contacts = assembly.state, assembly.work, assembly.model.contacts
    find_contacts(contacts, state.x, state.R, state.gap, work.point, work.frame)
    order, found = order_bodies(mechanism), {}
    for i, name in enumerate(assembly.contact_names):
        first = contacts.a[i] < len(order)
        pushed, way = (contacts.a[i], work.frame[i, 0]) if first else (contacts.b[i], -work.frame[i, 0])
        found[name] = (float(state.gap[i]), work.point[i].copy(), way, order[pushed])
    return found


def _world(mechanism: Mechanism, body: str, point: Any) -> Array:
    """Return a point of a body in the world, at the start."""
    return np.asarray(mechanism.bodies[body].origin + start_rotation(mechanism, body) @ np.array(point, float))


def _text(mechanism: Mechanism, value: float) -> str:
    return f"{value:.4g} {mechanism.unit('length')} here"


def _draw_bodies(axes: "Axes", mechanism: Mechanism, view: View, contacts: Contacts) -> float:
    """Draw the bodies at the start; return the size of what is drawn."""
    corners = []
    reach = float(np.ptp([point for _, point, *_ in contacts.values()] or np.zeros((1, 3)), axis=0).max())
    moving = [name for name, body in mechanism.bodies.items() if not body.fixed]
    for name, body in mechanism.bodies.items():
        origin, turn = np.array(body.origin), start_rotation(mechanism, name)
        touched = {contact: (point[None] - origin) @ turn for contact, (_, point, *_) in contacts.items()}
        part = part_of(mechanism, name, view, touched, reach)
        outline, *lines = [view.project(origin + p @ turn.T) for p in (part.outline, *part.lines, *part.faces)]
        corners += lines
        if not body.fixed and len(outline):
            corners.append(outline)
            colour = PALETTE[moving.index(name) % len(PALETTE)]
            axes.fill(*outline.T, facecolor=colour + "18", edgecolor=colour + "90", linewidth=0.9)
            x, y = outline.mean(axis=0)
            axes.text(x, y, name, color=colour, fontsize=7, ha="center", alpha=0.8)
        axes.plot(*joined(lines).T, color=MUTED, linewidth=0.6)
    return float(np.ptp(np.vstack(corners), axis=0).max()) if corners else 1.0


def _draw_measure(
    axes: "Axes", measure: Measure, view: View, size: float, colour: str, levels: dict[tuple[float, ...], int]
) -> None:
    """Draw a response, if there is anything to see of it from here; arrows from one point get levels of their own."""
    start, end, point = (view.project(p) for p in (measure.start, measure.end, measure.point))
    way = end - start
    long = float(np.linalg.norm(way))
    if long < ALONG_SIGHT * float(np.linalg.norm(measure.end - measure.start)) or long == 0.0:
        return
    way = way / long
    if measure.force:
        _arrow(axes, start, start + FORCE_ARROW * size * way, colour)
        _name(axes, start + FORCE_ARROW * size * way, measure.name, colour, way)
        return
    across = np.array([-way[1], way[0]])
    key = tuple(np.round([*start, *np.abs(way)], 3))
    level = levels[key] = levels.get(key, -1) + 1
    side = -1.0 if (point - start) @ across > 0 else 1.0
    a, b = (p + side * level * LEVEL * size * across for p in (start, end))
    axes.plot(*np.array([start, a]).T, color=colour, linewidth=0.7)
    near, shifted = min(((start, a), (end, b)), key=lambda pair: float(np.linalg.norm(point - pair[0])))
    axes.plot(*np.array([end, b]).T, color=colour, linewidth=0.7)
    axes.plot(*np.array([point, near, shifted]).T, color=colour, linewidth=0.7, linestyle=(0, (3, 2)))
    axes.plot(*point, "o", color=colour, markersize=3)
    axes.plot(*a, "|" if abs(way[0]) > abs(way[1]) else "_", color=colour, markersize=9)
    if long < SHORT * size:
        _arrow(axes, a - LEVEL * size * way, a, colour)
        _arrow(axes, b + LEVEL * size * way, b, colour)
        _name(axes, b + LEVEL * size * way, measure.name, colour, way)
    else:
        _arrow(axes, a, b, colour)
        beside = 0.5 * (a + b) + np.array([0.0, 0.35 * LEVEL * size])
        _name(
            axes,
            *((beside, measure.name, colour, 0 * way) if abs(way[0]) > abs(way[1]) else (b, measure.name, colour, way)),
        )


def _arrow(axes: "Axes", start: Array, end: Array, colour: str) -> None:
    style = {
        "arrowstyle": "-|>,head_width=0.22,head_length=0.5",
        "color": colour,
        "linewidth": 1.3,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axes.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=style)


def _name(axes: "Axes", place: Array, name: str, colour: str, away: Array) -> None:
    """Write a name at a place, or beside it in a direction."""
    sides = {1: "left", 0: "center", -1: "right"}
    ha = sides[int(np.sign(np.round(away[0])))]
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
    va = "center" if away[0] or not away.any() else "bottom" if away[1] > 0 else "top"
    axes.text(place[0], place[1], name, color=colour, fontsize=8, fontweight="bold", ha=ha, va=va, bbox=box, zorder=6)


def _explain(figure: Any, measure: Measure, colour: str, y: float) -> None:
    """Write beside the picture what an arrow is."""
    figure.text(0.72, y, measure.name, color=colour, fontsize=9, fontweight="bold")
    figure.text(0.72, y - 0.026, measure.title, color=INK, fontsize=8)
    figure.text(0.72, y - 0.05, measure.value, color=MUTED, fontsize=8)
