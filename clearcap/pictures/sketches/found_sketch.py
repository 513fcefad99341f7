"""A sketch of a CAD file's geometry, seen along most axes: silhouettes of parts, joints and candidate stops."""

import numpy as np

from clearcap.pictures.polylines import circle
from clearcap.pictures.sketches.sketch_canvas import Legend, Sketch, SketchCanvas, canvas_around
from clearcap.pictures.style import FORCE, INK, PALETTE
from clearcap.pictures.view import View, best_view
from engine.arrays import Array
from engine.cad.silhouette import silhouette
from engine.cad_import.found_features import FoundFeature
from engine.cad_import.found_geometry import FoundGeometry

MOST_NAMED = 40  # joints and candidates; more names would cover the parts
MOST_DRAWN = 100  # parts, the largest ones; a silhouette takes a tenth of a second


def view_of(found: FoundGeometry) -> View:
    """Return the plane to draw the found geometry on."""
    axes = [joint.pin.axis for joint in found.joints]
    return best_view(axes, [stop.pair.normal for stop in found.stops], np.zeros(3))


def sketch_found(found: FoundGeometry, places: list[FoundFeature]) -> Sketch:
    """Return the sketch of an assembly with its joints and candidate stops, named as in the mechanism file.

    Places from `found_features` of the kind "no joint" are left out.
    """
    view = view_of(found)
    largest = sorted(found.assembly.meshes, key=lambda mesh: -_size(mesh.vertices))[:MOST_DRAWN]
    meshes = sorted(largest, key=lambda mesh: _height(mesh.vertices, view.normal))
    outlines = [(mesh.part, silhouette(mesh, view.normal)) for mesh in meshes]
    canvas = canvas_around(view, [view.project(each) for _, pieces in outlines for each in pieces], [])
    for part, pieces in outlines:
        colour = part_colour(found, part)
        drawn = [canvas.area(piece, colour) for piece in pieces]
        if drawn:
            canvas.body_name(drawn[0], found.bodies[part], colour)
    shown = [place for place in places if place.kind != "no joint"]
    for place in shown[:MOST_NAMED]:
        _mark(canvas, place)
    return canvas.sketch(_legend(shown, len(found.assembly.meshes) - len(meshes)))


def part_colour(found: FoundGeometry, part: str) -> str:
    """Return the colour of a part."""
    return PALETTE[list(found.bodies).index(part) % len(PALETTE)]


def place_colour(place: FoundFeature) -> str:
    """Return the colour that marks a joint or a candidate."""
    return FORCE if place.kind == "facing" else INK


def place_lines(place: FoundFeature) -> list[Array]:
    """Return the polylines that mark a place, in the frame of the assembly, each of shape (k, 3).

    For a joint these are the circles at both ends of the hole and the axis, extended by a radius, or three circles of a
    socket; for a stop, the line between its faces.
    """
    if not place.radius:
        return [place.ends]
    along = place.ends[1] - place.ends[0]
    if not along.any():
        return [circle(place.ends[0], axis, place.radius) for axis in np.eye(3)]
    axis = along / np.linalg.norm(along)
    beyond = place.ends + place.radius * np.array([-axis, axis])
    return [*(circle(end, axis, place.radius) for end in place.ends), beyond]


def _height(vertices: Array, normal: Array) -> float:
    """Return the coordinate of a part's nearest point towards the viewer; minus infinity without triangles."""
    return float((vertices @ normal).max(initial=-np.inf))


def _size(vertices: Array) -> float:
    """Return the diagonal of a part's bounding box."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0))) if len(vertices) else 0.0


def _mark(canvas: SketchCanvas, place: FoundFeature) -> None:
    """Draw a place with its name and, for a joint, the radii of hole and pin."""
    colour, at = place_colour(place), canvas.on_canvas(place.middle)
    lines = [canvas.on_canvas(line) for line in place_lines(place)]
    for line in lines:
        canvas.stroke(line, colour)
    canvas.dot(at, colour)
    above = np.array([at[0], np.vstack(lines)[:, 1].min()])
    for text in filter(None, (place.name, place.radii)):
        canvas.name(above, np.array([0.0, -1.0]), text, colour)


def _legend(shown: list[FoundFeature], small: int) -> Legend:
    """Return the legend beside the drawing: one row per place, and rows for what is not shown."""
    rows = [(place.name, place.between, place.sizes, place_colour(place)) for place in shown[:MOST_NAMED]]
    if len(shown) > MOST_NAMED:
        rows.append((f"and {len(shown) - MOST_NAMED} more", "in the mechanism file", "", ""))
    if small:
        rows.append(("not drawn", f"the smallest parts: {small}", "", ""))
    return tuple(rows)
