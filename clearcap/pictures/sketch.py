"""A sketch of a mechanism at its start, with an arrow and a name for what each response measures, and its picture."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from clearcap.pictures.canvas import SketchCanvas, canvas_around
from clearcap.pictures.scene import zigzag
from clearcap.pictures.shapes import body_shape, linear_loads
from clearcap.pictures.style import FORCE, INK, MUTED, PALETTE, file_metadata, hide_axes, styled
from clearcap.pictures.view import View, choose_view, start_rotation
from clearcap.pictures.zones import draw_zones
from engine import Mechanism
from engine.arrays import Array
from engine.mechanism.bushings import Beam, Bushing
from engine.mechanism.couplings import GearPair
from reporting.spec import LegendEntry, MechanismDrawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEVEL, ARROW, SHORT = 16.0, 44.0, 14.0  # distance of parallel arrows; length of a force's; shortest between two ticks
LEVELS = 7  # of parallel arrows; further ones coincide with the first
LEAST_SEEN = 0.3  # projected length of a unit vector; a shorter one is along the line of sight


_Measured = tuple[str, Array, Array, Array, str]  # kind, start, end, point and value of a `Measurement`


class StartContact(NamedTuple):
    """A contact at the start pose."""

    gap: float  # distance between its sides [length]
    point: Array  # in the world [length], (3,)
    normal: Array  # direction of the normal force on ``body``, (3,)
    body: str  # the first moving body of the two


@dataclass(frozen=True)
class Measurement:
    """A response to be drawn.

    The kinds are "length" from ``start`` to ``end``; "arrow", a force or speed at ``start`` towards ``end``; "turn" at
    ``start`` about the axis to ``end``; "point", a force without a single direction; "span", a spring from ``start`` to
    ``end``; "none", a response without a place.
    """

    name: str
    title: str
    kind: str
    start: Array  # start and end in the world, (3,); from one to the other is the positive direction
    end: Array
    point: Array  # the measured point, beside one end or at it, (3,)
    value: str  # of a length at the start pose with its unit; otherwise the measured quantity and its body


def measurements(mechanism: Mechanism, contacts: dict[str, StartContact]) -> Iterator[Measurement]:
    """Yield what each response measures at the start pose, in the order of the file; see `contacts_at_start`."""
    for name, response in mechanism.responses.items():
        kind, start, end, point, value = _measured(mechanism, response, contacts)
        yield Measurement(name, response.title, kind, start, end, point, value)


def _measured(mechanism: Mechanism, response: Any, contacts: dict[str, StartContact]) -> _Measured:
    if response.type == "position":
        return _length(mechanism, response)
    if response.type == "velocity":
        body, along = response.to.body, _direction(mechanism, response.direction)
        at = _world(mechanism, body, response.to.point)
        return "arrow", at, at + along, at, f"speed of a point of {body}"
    if response.type in ("gap", "contact_force"):
        return _of_contact(mechanism, response, contacts)
    if response.type in ("joint_force", "joint_torque"):
        side, what = mechanism.joints[response.joint].sides[1], response.type.removeprefix("joint_")
        at = _world(mechanism, side.body, side.point)
        if response.direction is None:
            return "point", at, at, at, f"size of the {what} on {side.body}"
        kind, way = "arrow" if what == "force" else "turn", _direction(mechanism, response.direction)
        return kind, at, at + way, at, f"{'arrow: ' if what == 'force' else ''}{what} on {side.body}"
    if response.type == "spring_force":
        spring: Any = mechanism.springs[response.spring]
        a, b = (_world(mechanism, end.body, end.point) for end in (spring.a, spring.b))
        return "span", a, b, b, f"force of spring {response.spring}"
    if response.type == "spring_torque":
        torsion: Any = mechanism.springs[response.spring]
        return _turn(mechanism, torsion.b, torsion.a, torsion.axis, f"torque on {torsion.b}")
    if response.type.startswith("motion_"):
        return _of_motion(mechanism, response)
    if response.type in ("angle", "angular_velocity"):
        against = response.relative_to
        what = "rotation" if response.type == "angle" else "angular velocity"
        return _turn(mechanism, response.body, against, response.axis, f"{what} of {response.body}")
    return "none", np.zeros(3), np.zeros(3), np.zeros(3), _without_place(response)


def _length(mechanism: Mechanism, response: Any) -> _Measured:
    """Return a position along a direction, measured from a point, or from the measured point's foot on an axis."""
    start, direction = response.from_, _direction(mechanism, response.direction)
    to = _world(mechanism, response.to.body, response.to.point)
    if start.axis is None:
        begin = _world(mechanism, start.body, start.point)
    else:
        begin = _world(mechanism, start.body, start.axis.point)
        axis = start_rotation(mechanism, start.body) @ start.axis.axis
        begin = begin + (to - begin) @ axis * axis
    value = float(direction @ (to - begin)) + response.offset
    end = begin + value * direction
    first, last = (begin, end) if value >= 0 else (end, begin)
    return "length", first, last, to, _value_text(mechanism, value)


def _of_contact(mechanism: Mechanism, response: Any, contacts: dict[str, StartContact]) -> _Measured:
    if response.contact not in contacts:
        return "none", np.zeros(3), np.zeros(3), np.zeros(3), f"contact {response.contact}"
    gap, point, normal, body = contacts[response.contact]
    if response.type == "gap":
        return "length", point, point + gap * normal, point, _value_text(mechanism, gap)
    if response.component == "friction":
        return "point", point, point, point, f"friction on {body}"
    return "arrow", point, point + normal, point, f"arrow: force on {body}"


def _turn(mechanism: Mechanism, body: str, against: str | None, axis: Any, value: str) -> _Measured:
    """Return a rotation of a body about an axis of another, at a joint between them or else at its centre of mass."""
    others = {against} if against else {name for name, each in mechanism.bodies.items() if each.fixed}
    sides = [joint.sides for joint in mechanism.joints.values()]
    between = [(a, b) for pair in sides for a, b in (pair, pair[::-1]) if a.body == body and b.body in others]
    at = _world(mechanism, body, between[0][0].point if between else mechanism.bodies[body].center_of_mass)
    turned = (start_rotation(mechanism, against) if against else np.eye(3)) @ np.asarray(axis)
    return "turn", at, at + turned, at, value


def _of_motion(mechanism: Mechanism, response: Any) -> _Measured:
    """Return the travel, force, torque or work of a prescribed motion, at the point or axis that it leads."""
    motion: Any = mechanism.motions[response.motion]
    value = f"{response.type.removeprefix('motion_')} of motion {response.motion}"
    if "about" in type(motion).model_fields:
        return _turn(mechanism, motion.body, motion.relative_to, motion.about.axis, value)
    at, way = _world(mechanism, motion.body, motion.along.point), np.asarray(motion.along.direction)
    if motion.relative_to:
        way = start_rotation(mechanism, motion.relative_to) @ way
    return "arrow", at, at + way, at, value


def _without_place(response: Any) -> str:
    """Describe a response that has no place in the mechanism."""
    if response.type == "difference":
        return f"{response.of[0]} minus {response.of[1]}"
    if response.type == "condition":
        return f"1 if {response.condition}, else 0"
    if response.type in ("impulse", "mean"):
        return f"{response.type} of {response.response}"
    if response.type in ("bounces", "friction_work"):
        return f"{response.type.replace('_', ' ')} of contact {response.contact}"
    if response.type == "formula":
        return str(response.formula)
    return "a time" if response.type == "time" else str(response.type).replace("_", " ")


def _direction(mechanism: Mechanism, along: Any) -> Array:
    rotation = start_rotation(mechanism, along.body) if along.body else np.eye(3)
    return np.asarray(rotation @ along.vector)


def contacts_at_start(mechanism: Mechanism) -> dict[str, StartContact]:
    """Return every contact at the start pose, by name."""
    # compiled code, which other pictures do not need
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
    for name in [each for each in mechanism.contacts if each not in at_start]:  # the nearest point of two profiles
        own = [at_start[assembly.contact_names[i]] for i in assembly.numbers(name)]
        at_start[name] = min(own, key=lambda at: (not at.normal.any(), at.gap))
    return at_start


def _world(mechanism: Mechanism, body: str, point: Any) -> Array:
    """Return a point of a body in the world, at the start."""
    return np.asarray(mechanism.bodies[body].origin + start_rotation(mechanism, body) @ np.array(point, float))


def _value_text(mechanism: Mechanism, value: float) -> str:
    return f"{value:.4g} {mechanism.unit('length')} here"


def sketch_mechanism(mechanism: Mechanism, widest: Mechanism | None = None) -> MechanismDrawing:
    """Return the sketch of a mechanism with what its responses measure, and with what is off its drawing.

    `widest` has the largest deviations that a campaign draws, which are shown as zones then.
    """
    view, contacts = choose_view(mechanism), contacts_at_start(mechanism)
    drawn = list(measurements(mechanism, contacts))
    drawing = _bodies(mechanism, view, contacts, [m for m in drawn if m.kind != "none"])
    legend = []
    for i, measurement in enumerate(drawn):
        colour = FORCE if measurement.kind in ("arrow", "point") else PALETTE[i % len(PALETTE)]
        hidden = measurement.kind != "none" and _draw_measurement(drawing, measurement, colour)
        value = f"{measurement.value}, along the line of sight" if hidden else measurement.value
        seen_in = "" if measurement.kind == "none" else colour
        legend.append(LegendEntry(measurement.name, measurement.title, value, seen_in))
    legend += draw_zones(drawing, widest or mechanism, varied=widest is not None)
    return drawing.sketch(tuple(legend))


def _bodies(
    mechanism: Mechanism, view: View, contacts: dict[str, StartContact], measured: list[Measurement]
) -> SketchCanvas:
    shapes = []
    extent = float(np.ptp([contact.point for contact in contacts.values()] or np.zeros((1, 3)), axis=0).max())
    for name in mechanism.bodies:
        origin, rotation = np.array(mechanism.bodies[name].origin), start_rotation(mechanism, name)
        touched = {contact: (at.point[None] - origin) @ rotation for contact, at in contacts.items()}
        shape = body_shape(mechanism, name, view, touched, extent)
        outline, *lines = [origin + p @ rotation.T for p in (shape.outline, *shape.lines, *shape.faces)]
        shapes.append((name, outline, lines))
    fixed = [name for name, body in mechanism.bodies.items() if body.fixed]
    seen = [view.project(p) for name, outline, lines in shapes for p in ([] if name in fixed else [outline]) + lines]
    ends = [view.project(np.array([m.start, m.end if m.kind in ("length", "span") else m.start])) for m in measured]
    springs = [np.array([_world(mechanism, e.body, e.point) for e in link]) for link in linear_loads(mechanism)]
    drawing = canvas_around(view, [p for p in seen if len(p)], ends + [view.project(p) for p in springs])
    moving = [name for name, _, _ in shapes if name not in fixed]
    for name, outline, lines in shapes:
        if name in moving and len(outline):
            colour = PALETTE[moving.index(name) % len(PALETTE)]
            drawing.body_name(drawing.area(outline, colour), name, colour)
        for line in lines:
            drawing.stroke(drawing.on_canvas(line), MUTED)
    for link in springs:
        drawing.stroke(zigzag(*drawing.on_canvas(link)), MUTED)
    for coupling in mechanism.couplings.values():  # from joint to joint, from gear to gear
        sides: Any = []
        if isinstance(coupling, GearPair):
            sides = coupling.gears
        else:
            sides = [mechanism.joints[term.joint].sides[1] for term in coupling.terms]
        places = [
            mechanism.bodies[side.body].origin + start_rotation(mechanism, side.body) @ side.point for side in sides
        ]
        drawing.stroke(np.array([drawing.on_canvas(place) for place in places]), MUTED, "dashed")
    for joint in mechanism.joints.values():
        ends = [drawing.on_canvas(_world(mechanism, side.body, side.point)) for side in joint.sides]
        if isinstance(joint, Beam):
            drawing.stroke(np.array(ends), MUTED, "thick")
        elif isinstance(joint, Bushing):
            drawing.dot(ends[0], MUTED)
    return drawing


def _draw_measurement(drawing: SketchCanvas, measurement: Measurement, colour: str) -> bool:
    """Draw what a response measures; return whether its direction is along the line of sight, drawn as a dot."""
    start, end, point = (drawing.on_canvas(p) for p in (measurement.start, measurement.end, measurement.point))
    true = float(np.linalg.norm(measurement.end - measurement.start))
    seen = drawing.view.project(measurement.end - measurement.start) * [1.0, -1.0]
    length = float(np.linalg.norm(seen))
    if measurement.kind == "turn":
        _draw_turn(drawing, start, measurement.name, colour, facing=length < LEAST_SEEN * true)
        return False
    if measurement.kind == "point" or length < LEAST_SEEN * true or length == 0.0:
        drawing.dot(point, colour)
        drawing.name(point, np.array([0.0, -1.0]), measurement.name, colour)
        return measurement.kind not in ("point", "span") and true > 0.0
    along = seen / length
    if measurement.kind == "arrow":
        tip = start + ARROW * along
        drawing.stroke(np.array([start, tip]), colour, "arrow")
        drawing.name(tip, along, measurement.name, colour)
    elif measurement.kind == "span":
        drawing.stroke(np.array([start, end]), colour, "thick")
        drawing.name(0.5 * (start + end), np.array([-along[1], along[0]]), measurement.name, colour)
    else:
        _draw_length(drawing, (start, end, point), along, measurement.name, colour)
    return False


def _draw_length(
    drawing: SketchCanvas, places: tuple[Array, Array, Array], along: Array, name: str, colour: str
) -> None:
    """Draw a length with its measured point; lengths from the same point along the same line are drawn side by side."""
    start, end, point = places
    across = np.array([-along[1], along[0]])
    key = tuple(np.round([*start, *np.abs(along)], 2))
    ends = drawing.levels.setdefault(key, [])
    end_here = tuple(np.round([*end, *point], 2))
    if end_here not in ends:  # otherwise it is the same arrow
        ends.append(end_here)
    level = ends.index(end_here) % LEVELS
    side = -1.0 if (point - start) @ across > 0 else 1.0
    a, b = (p + side * level * LEVEL * across for p in (start, end))
    near, shifted = min(((start, a), (end, b)), key=lambda pair: float(np.linalg.norm(point - pair[0])))
    for line in (np.array([start, a]), np.array([end, b])):
        drawing.stroke(line, colour)
    drawing.stroke(np.array([point, near, shifted]), colour, "dashed")
    drawing.dot(point, colour)
    for tick in (a, b):
        drawing.stroke(np.array([tick - 5 * across, tick + 5 * across]), colour)
    if float(np.linalg.norm(b - a)) < SHORT:  # two arrows from outside
        drawing.stroke(np.array([a - 2 * LEVEL * along, a]), colour, "arrow")
        drawing.stroke(np.array([b + 2 * LEVEL * along, b]), colour, "arrow")
        drawing.name(b + 2 * LEVEL * along, along, name, colour)
    else:
        drawing.stroke(np.array([a, b]), colour, "arrow")
        drawing.name(0.5 * (a + b), side * across, name, colour)


def _draw_turn(drawing: SketchCanvas, centre: Array, name: str, colour: str, *, facing: bool) -> None:
    if facing:
        angle = np.linspace(-0.2 * np.pi, 1.2 * np.pi, 25)[:, None]
        arc = centre + 0.4 * ARROW * np.hstack([np.cos(angle), -np.sin(angle)])
        drawing.stroke(arc, colour, "arrow")
    drawing.dot(centre, colour)
    drawing.name(centre + (np.array([0.0, -0.4 * ARROW]) if facing else 0.0), np.array([0.0, -1.0]), name, colour)


WIDE, DPI = 9.0, 100  # inches
SHARE = 0.66  # of the width for the mechanism; the rest is for the legend
ROW = 0.5  # inches; height of an entry of the legend
WIDTHS = {"thin": 0.7, "dashed": 0.7, "thick": 2.5, "arrow": 1.3}


def plot_measurements(mechanism: Mechanism, path: Path) -> None:
    """Write a picture (PNG, SVG or PDF) of the mechanism at its start pose, with what its responses measure."""
    sketch, title = sketch_mechanism(mechanism), mechanism.title or mechanism.name
    plot_sketch(sketch, f"{title}: what is measured", describe(mechanism, sketch), path)


def describe(mechanism: Mechanism, sketch: MechanismDrawing) -> str:
    """Describe the picture in words."""
    listed = "; ".join(f"{name}: {', '.join(filter(None, rest))}" for name, *rest, _ in sketch.legend)
    return f"{mechanism.title or mechanism.name} at its start, with arrows for what is measured. {listed}."


def plot_sketch(sketch: MechanismDrawing, heading: str, description: str, path: Path) -> None:
    """Write a sketch, ``.png``, ``.svg`` or ``.pdf``, with a description for readers who cannot see it."""
    from matplotlib.figure import Figure

    inch = SHARE * WIDE / sketch.width  # per point of the canvas
    tall = max(inch * sketch.height, ROW * len(sketch.legend)) + 0.5
    with styled():
        figure = Figure(figsize=(WIDE, tall))
        figure.text(0.02, 1 - 0.25 / tall, heading, fontsize=10, va="center")
        part = inch * sketch.height / tall
        axes = figure.add_axes((0.01, 1 - 0.45 / tall - part, SHARE, part))
        hide_axes(axes)
        axes.set(xlim=(0, sketch.width), ylim=(sketch.height, 0))
        _draw_sketch(axes, sketch, 72 * inch * sketch.text)
        for i, (name, meaning, value, colour) in enumerate(sketch.legend):
            y = 1 - (0.6 + ROW * i) / tall
            figure.text(SHARE + 0.03, y, name, color=colour or INK, fontsize=9, fontweight="bold")
            lines = [(text, ink) for text, ink in ((meaning, INK), (value, MUTED)) if text]
            for below, (text, ink) in zip((0.16, 0.31), lines, strict=False):  # no gap without a title
                figure.text(SHARE + 0.03, y - below / tall, text, color=ink, fontsize=8)
        figure.savefig(path, dpi=DPI, metadata=file_metadata(path.suffix, description))


def _draw_sketch(axes: "Axes", sketch: MechanismDrawing, size: float) -> None:
    """Draw a sketch on axes whose units are the points of its canvas, with text of a size [pt]."""
    for corners, colour in sketch.areas:
        axes.fill(*zip(*corners, strict=True), facecolor=colour + "18", edgecolor=colour + "90", linewidth=0.9)
    for stroke in sketch.strokes:
        across, down = zip(*stroke.points, strict=True)
        dash = (0, (3, 2)) if stroke.style == "dashed" else "-"
        axes.plot(across, down, color=stroke.colour, linewidth=WIDTHS[stroke.style], linestyle=dash)
        if stroke.style == "arrow" and len(stroke.points) > 1:
            style = "-|>,head_width=0.22,head_length=0.5"
            head = {"arrowstyle": style, "color": stroke.colour, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", xy=stroke.points[-1], xytext=stroke.points[-2], arrowprops=head)
    for x, y, colour in sketch.dots:
        axes.plot(x, y, "o", color=colour, markersize=3)
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
    for word in sketch.words:
        font: Any = {"fontsize": (0.85 if word.bold else 0.7) * size, "fontweight": "bold" if word.bold else "normal"}
        place: Any = {"ha": "center", "va": "center", "bbox": box, "zorder": 6, "linespacing": 1.1}
        axes.text(word.x, word.y, "\n".join(word.lines), color=word.colour, **font, **place)
