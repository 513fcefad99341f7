"""What the responses of a mechanism measure: lengths, gaps and contact forces as arrows, at the start pose."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from campaign.pictures.animation_figure import join_lines
from campaign.pictures.body_shapes import body_shape
from campaign.pictures.curves import file_metadata
from campaign.pictures.style import FORCE, INK, MUTED, PALETTE, hide_axes, styled
from campaign.pictures.view import View, choose_view, start_rotation
from engine import Mechanism
from engine.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE, DPI = (9.0, 6.2), 100
LEVEL = 0.07  # distance of arrows that start at one point along one direction, in sizes of the mechanism
FORCE_ARROW = 0.12  # length of the arrow of a force, in sizes of the mechanism
SHORT = 0.03  # of the size of the mechanism: shorter lengths are marked by arrows from outside
LEAST_SEEN = 0.3  # projected length of a unit vector: less is not drawn


class StartContact(NamedTuple):
    """A contact at the start pose.

    Attributes
    ----------
    gap : float
        Distance of its sides [length].
    point : ndarray, shape (3,)
        Contact point in the world [length].
    normal : ndarray, shape (3,)
        Direction of the normal force on ``body``.
    body : str
        The first of its two bodies that moves.
    """

    gap: float
    point: Array
    normal: Array
    body: str


@dataclass(frozen=True)
class Measurement:
    """A response as drawn.

    Attributes
    ----------
    name, title : str
        Of the response.
    force : bool
        Whether it is the force at ``start``; otherwise it is the length from ``start`` to ``end``.
    start, end : ndarray, shape (3,)
        Ends of an arrow in the world that points in the positive direction.
    point : ndarray, shape (3,)
        The measured point, beside one end or at it.
    value : str
        At the start pose, with its unit; of a force the body it acts on.
    """

    name: str
    title: str
    force: bool
    start: Array
    end: Array
    point: Array
    value: str


def measurements(mechanism: Mechanism, contacts: dict[str, StartContact]) -> Iterator[Measurement]:
    """Yield the responses that are lengths, gaps or contact forces.

    Parameters
    ----------
    mechanism : Mechanism
        Its responses.
    contacts : dict of str to StartContact
        See `contacts_at_start`.

    Yields
    ------
    Measurement
        One a response, at the start pose.
    """
    for name, response in mechanism.responses.items():
        if response.type == "position":
            yield _length(mechanism, name, response)
        elif response.type == "gap" and response.contact in contacts:
            gap, point, normal, _ = contacts[response.contact]
            text = _value_text(mechanism, gap)
            yield Measurement(name, response.title, False, point, point + gap * normal, point, text)
        elif response.type == "contact_force" and response.contact in contacts and response.bound is None:
            _, point, normal, body = contacts[response.contact]
            yield Measurement(name, response.title, True, point, point + normal, point, f"on {body}")


def plot_measurements(mechanism: Mechanism, path: Path) -> None:
    """Write the mechanism at its start pose, with what its responses measure.

    Parameters
    ----------
    mechanism : Mechanism
        What to draw.
    path : Path
        File to write: ``.png``, ``.svg`` or ``.pdf``.
    """
    from matplotlib.figure import Figure

    view = choose_view(mechanism)
    contacts = contacts_at_start(mechanism)
    drawn = list(measurements(mechanism, contacts))
    with styled():
        figure = Figure(figsize=SIZE)
        figure.suptitle(f"{mechanism.title or mechanism.name}: what is measured", x=0.02, ha="left", fontsize=10)
        axes = figure.add_axes((0.02, 0.03, 0.68, 0.9))
        hide_axes(axes)
        size = _draw_bodies(axes, mechanism, view, contacts)
        levels: dict[tuple[float, ...], int] = {}
        for i, measurement in enumerate(drawn):
            colour = FORCE if measurement.force else PALETTE[i % len(PALETTE)]
            _draw_measurement(axes, measurement, view, size, colour, levels)
            _explain(figure, measurement, colour, 0.9 - i * min(0.075, 0.85 / len(drawn)))
        figure.savefig(path, dpi=DPI, metadata=file_metadata(path.suffix, describe(mechanism, drawn)))


def describe(mechanism: Mechanism, drawn: list[Measurement]) -> str:
    """Return in words what the picture shows."""
    listed = "; ".join(f"{m.name}: {m.title}, {m.value}" for m in drawn)
    return f"{mechanism.title or mechanism.name} at its start, with arrows for what is measured. {listed}."


def _length(mechanism: Mechanism, name: str, response: Any) -> Measurement:
    """Return a position: from a point, or from the foot of the measured point on an axis, along a direction."""
    start, along = response.from_, response.direction
    rotation = start_rotation(mechanism, along.body) if along.body else np.eye(3)
    direction = rotation @ along.vector
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
    return Measurement(name, response.title, False, first, last, to, _value_text(mechanism, value))


def contacts_at_start(mechanism: Mechanism) -> dict[str, StartContact]:
    """Return every contact at the start pose, by name."""
    # compiled code, which other pictures do without
    from engine.assembly import assemble
    from engine.assembly.frames import order_bodies
    from engine.kernels.contact_geometry.gaps import find_contacts

    assembly = assemble(mechanism)
    state, work, contacts = assembly.state, assembly.work, assembly.model.contacts
    find_contacts(contacts, state.x, state.R, state.gap, work.sites.point, work.sites.frame)
    order, at_start = order_bodies(mechanism), {}
    for i, name in enumerate(assembly.contact_names):
        first = contacts.a[i] < len(order)
        pushed, normal = (contacts.a[i], work.sites.frame[i, 0]) if first else (contacts.b[i], -work.sites.frame[i, 0])
        at_start[name] = StartContact(float(state.gap[i]), work.sites.point[i].copy(), normal, order[pushed])
    return at_start


def _world(mechanism: Mechanism, body: str, point: Any) -> Array:
    """Return a point of a body in the world, at the start."""
    return np.asarray(mechanism.bodies[body].origin + start_rotation(mechanism, body) @ np.array(point, float))


def _value_text(mechanism: Mechanism, value: float) -> str:
    return f"{value:.4g} {mechanism.unit('length')} here"


def _draw_bodies(axes: "Axes", mechanism: Mechanism, view: View, contacts: dict[str, StartContact]) -> float:
    """Draw the bodies at the start; return the size of what is drawn [length]."""
    corners = []
    extent = float(np.ptp([contact.point for contact in contacts.values()] or np.zeros((1, 3)), axis=0).max())
    moving = [name for name, body in mechanism.bodies.items() if not body.fixed]
    for name, body in mechanism.bodies.items():
        origin, rotation = np.array(body.origin), start_rotation(mechanism, name)
        touched = {contact: (at.point[None] - origin) @ rotation for contact, at in contacts.items()}
        shape = body_shape(mechanism, name, view, touched, extent)
        outline, *lines = [view.project(origin + p @ rotation.T) for p in (shape.outline, *shape.lines, *shape.faces)]
        corners += lines
        if not body.fixed and len(outline):
            corners.append(outline)
            colour = PALETTE[moving.index(name) % len(PALETTE)]
            axes.fill(*outline.T, facecolor=colour + "18", edgecolor=colour + "90", linewidth=0.9)
            x, y = outline.mean(axis=0)
            axes.text(x, y, name, color=colour, fontsize=7, ha="center", alpha=0.8)
        axes.plot(*join_lines(lines).T, color=MUTED, linewidth=0.6)
    return float(np.ptp(np.vstack(corners), axis=0).max()) if corners else 1.0


def _draw_measurement(
    axes: "Axes", measurement: Measurement, view: View, size: float, colour: str, levels: dict[tuple[float, ...], int]
) -> None:
    """Draw a response, unless it is nearly along the line of sight.

    Lengths from one point along one direction are drawn beside each other; ``levels`` counts them.
    """
    start, end, point = (view.project(p) for p in (measurement.start, measurement.end, measurement.point))
    along = end - start
    length = float(np.linalg.norm(along))
    if length < LEAST_SEEN * float(np.linalg.norm(measurement.end - measurement.start)) or length == 0.0:
        return
    along = along / length
    if measurement.force:
        _arrow(axes, start, start + FORCE_ARROW * size * along, colour)
        _name(axes, start + FORCE_ARROW * size * along, measurement.name, colour, along)
        return
    across = np.array([-along[1], along[0]])
    key = tuple(np.round([*start, *np.abs(along)], 3))
    level = levels[key] = levels.get(key, -1) + 1
    side = -1.0 if (point - start) @ across > 0 else 1.0
    a, b = (p + side * level * LEVEL * size * across for p in (start, end))
    axes.plot(*np.array([start, a]).T, color=colour, linewidth=0.7)
    near, shifted = min(((start, a), (end, b)), key=lambda pair: float(np.linalg.norm(point - pair[0])))
    axes.plot(*np.array([end, b]).T, color=colour, linewidth=0.7)
    axes.plot(*np.array([point, near, shifted]).T, color=colour, linewidth=0.7, linestyle=(0, (3, 2)))
    axes.plot(*point, "o", color=colour, markersize=3)
    axes.plot(*a, "|" if abs(along[0]) > abs(along[1]) else "_", color=colour, markersize=9)
    if length < SHORT * size:
        _arrow(axes, a - LEVEL * size * along, a, colour)
        _arrow(axes, b + LEVEL * size * along, b, colour)
        _name(axes, b + LEVEL * size * along, measurement.name, colour, along)
        return
    _arrow(axes, a, b, colour)
    if abs(along[0]) > abs(along[1]):
        above_middle = 0.5 * (a + b) + np.array([0.0, 0.35 * LEVEL * size])
        _name(axes, above_middle, measurement.name, colour, 0 * along)
    else:
        _name(axes, b, measurement.name, colour, along)


def _arrow(axes: "Axes", start: Array, end: Array, colour: str) -> None:
    style = {
        "arrowstyle": "-|>,head_width=0.22,head_length=0.5",
        "color": colour,
        "linewidth": 1.3,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axes.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=style)


def _name(axes: "Axes", position: Array, name: str, colour: str, away: Array) -> None:
    """Write a name at a position, or beside it in the direction ``away``."""
    sides = {1: "left", 0: "center", -1: "right"}
    ha = sides[int(np.sign(np.round(away[0])))]
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
    va = "center" if away[0] or not away.any() else "bottom" if away[1] > 0 else "top"
    font: Any = {"color": colour, "fontsize": 8, "fontweight": "bold"}
    axes.text(position[0], position[1], name, ha=ha, va=va, bbox=box, zorder=6, **font)


def _explain(figure: Any, measurement: Measurement, colour: str, y: float) -> None:
    """Write beside the picture what an arrow is."""
    figure.text(0.72, y, measurement.name, color=colour, fontsize=9, fontweight="bold")
    figure.text(0.72, y - 0.026, measurement.title, color=INK, fontsize=8)
    figure.text(0.72, y - 0.05, measurement.value, color=MUTED, fontsize=8)
