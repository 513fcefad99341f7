"""What was found in a CAD file: a sketch of it, and a self-contained HTML page with triangle meshes of the parts."""

import json
import re
import shlex
from base64 import b64encode
from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from clearcap.pictures.canvas import SketchCanvas, canvas_around
from clearcap.pictures.shapes import circle
from clearcap.pictures.style import FORCE, INK, PALETTE
from clearcap.pictures.view import View, best_view
from engine.arrays import Array, Integers
from engine.cad.cad_model import TriangleMesh
from engine.cad.silhouette import silhouette
from engine.cad_import.drawn_tolerances import unused_tolerances
from engine.cad_import.found_features import FoundFeature, part_text
from engine.cad_import.found_geometry import FoundGeometry
from engine.cad_import.proposed_joints import AXIAL_PLAY, RADIAL_PLAY
from engine.cad_import.proposed_text import open_questions
from engine.mechanism.materials import DENSITIES
from reporting.render.page_templates import page_environment
from reporting.spec import LegendEntry, MechanismDrawing

MOST_NAMED = 40  # joints and candidates; more names would cover the parts
MOST_DRAWN = 100  # parts, the largest ones; a silhouette takes a tenth of a second


def view_of(found: FoundGeometry) -> View:
    """Return the plane to draw the found geometry on."""
    axes = [joint.pin.axis for joint in found.joints]
    return best_view(axes, [stop.pair.normal for stop in found.stops], np.zeros(3))


def sketch_found(found: FoundGeometry, places: list[FoundFeature]) -> MechanismDrawing:
    """Return the sketch of an assembly with its joints and candidate stops, named as in the mechanism file."""
    view = view_of(found)
    largest = sorted(found.assembly.meshes, key=lambda mesh: -_size(mesh.vertices))[:MOST_DRAWN]
    meshes = sorted(largest, key=lambda mesh: (mesh.vertices @ view.normal).max(initial=-np.inf))  # the nearest last
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
    rows = [LegendEntry(p.name, p.between, p.sizes, place_colour(p)) for p in shown[:MOST_NAMED]]
    if len(shown) > MOST_NAMED:
        rows.append(LegendEntry(f"and {len(shown) - MOST_NAMED} more", "in the mechanism file", "", ""))
    if small := len(found.assembly.meshes) - len(meshes):
        rows.append(LegendEntry("not drawn", f"the smallest parts: {small}", "", ""))
    return canvas.sketch(tuple(rows))


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


def _size(vertices: Array) -> float:
    return float(np.linalg.norm(np.ptp(vertices, axis=0))) if len(vertices) else 0.0


def _mark(canvas: SketchCanvas, place: FoundFeature) -> None:
    colour, at = place_colour(place), canvas.on_canvas(place.middle)
    lines = [canvas.on_canvas(line) for line in place_lines(place)]
    for line in lines:
        canvas.stroke(line, colour)
    canvas.dot(at, colour)
    above = np.array([at[0], np.vstack(lines)[:, 1].min()])
    for text in filter(None, (place.name, place.radii)):
        canvas.name(above, np.array([0.0, -1.0]), text, colour)


MOST_TRIANGLES = 250_000  # of all parts together; beyond it they are drawn coarser. A page of this many has about 8 MB
_FILES = resources.files("clearcap.import_page") / "static"
STATIC = {
    "three": "three.min.js",
    "text_script": "mechanism_text.js",
    "answers_script": "answers.js",
    "script": "import_page.js",
    "style": "import_page.css",
}
PLAYS = {RADIAL_PLAY: "Radial play", AXIAL_PLAY: "Axial play"}
_ABOUT = re.compile(r"(bodies|joints)\.([\w-]+)")
KINDS = {"joint": "Joints", "facing": "Faces that could be stops", "no joint": "Pins and holes that form no joint"}


_FINEST, _WIDER = 4000, 1.25  # cells along the longest side in the finest grid; width ratio of successive grids
_STEPS = 40  # number of grids; in the last one a part is in one cell, and no triangle is left


@dataclass(frozen=True, eq=False)
class PageMesh:
    """The triangle mesh of a part."""

    vertices: NDArray[np.float32]  # relative to the page's centre, (n, 3)
    triangles: NDArray[np.uint32]  # rows of `vertices`, counter-clockwise seen from outside, sorted by face, (m, 3)
    stretches: dict[int, tuple[int, int]]  # first triangle and number of triangles of each face, by its number


@dataclass(frozen=True)
class ImportFiles:
    """The files that the page is about."""

    step: str  # name of the CAD file
    mechanism: str  # name of the mechanism file
    drawing: bytes  # SVG of the parts and the joints found


def import_page(found: FoundGeometry, places: list[FoundFeature], text: str, files: ImportFiles) -> str:
    """Return the page as HTML; `places` are joints and candidates, `text` is that of the mechanism file."""
    vertices = np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in found.assembly.meshes)])
    low, high = (vertices.min(axis=0), vertices.max(axis=0)) if len(vertices) else (np.zeros(3), np.ones(3))
    centre = (low + high) / 2
    meshes, deviation = page_meshes(found.assembly.meshes, centre, MOST_TRIANGLES)
    parts = {f"part-{number}": part for number, part in enumerate(found.assembly.parts)}  # by the ids of their rows
    names = {("bodies", found.bodies[part.name]): row for row, part in parts.items()}
    names |= {("joints", p.name): f"place-{i}" for i, p in enumerate(places) if p.kind == "joint"}
    abouts = [(question, _ABOUT.match(question.text)) for question in open_questions(text)]
    update = f"clearcap mechanism import {shlex.quote(files.step)} --update {shlex.quote(files.mechanism)}"
    scene = _scene(found, places, meshes, centre) | {"size": float(np.linalg.norm(high - low))}
    scene |= {"text": text, "update": update}
    template = page_environment("clearcap.import_page").get_template("import_page.html.j2")
    return template.render(
        found=found,
        files=files,
        drawing=b64encode(files.drawing).decode(),
        drawing_text=f"The parts, seen along most of the axes. {'; '.join(place.text for place in places)}",
        parts=[(row, part, part_colour(found, part.name)) for row, part in parts.items()],
        part_text=part_text,
        kinds=[(title, [p for p in enumerate(places) if p[1].kind == kind]) for kind, title in KINDS.items()],
        questions=[(question, match and names.get((match[1], match[2]))) for question, match in abouts],
        plays=[(key, label) for key, label in PLAYS.items() if f"# {key} = " in text],
        materials=sorted(DENSITIES),
        deviation=deviation,
        not_used=unused_tolerances(found),
        scene=Markup(json.dumps(scene).replace("<", "\\u003c")),  # so that no text can end the script element
        **{name: Markup((_FILES / file).read_text("utf-8")) for name, file in STATIC.items()},
    )


def _scene(found: FoundGeometry, places: list[FoundFeature], meshes: list[PageMesh], centre: Array) -> dict[str, Any]:
    view = view_of(found)
    rows = {part.name: f"part-{number}" for number, part in enumerate(found.assembly.parts)}
    wanted = {face for place in places for face in place.faces}
    normals = {face.number: face.axis for face in found.assembly.faces if face.kind == "plane"}
    return {
        "view": [each.tolist() for each in (view.right, view.up, view.normal)],
        "parts": [
            {
                "row": row,
                "name": found.bodies[part],
                "colour": part_colour(found, part),
                "vertices": b64encode(mesh.vertices.astype("<f4").tobytes()).decode(),
                "triangles": b64encode(mesh.triangles.astype("<u4").tobytes()).decode(),
                "faces": [stretch for face, stretch in mesh.stretches.items() if face in wanted],
                "numbers": [face for face in mesh.stretches if face in wanted],
                "planes": [
                    [*stretch, *(np.round(normals[face], 9) + 0.0).tolist()]  # + 0.0 turns -0.0 into 0.0
                    for face, stretch in mesh.stretches.items()
                    if face in normals
                ],
            }
            for (part, row), mesh in zip(rows.items(), meshes, strict=True)
        ],
        "places": [
            {
                "row": f"place-{i}",
                "name": place.name,
                "shown": place.kind != "no joint",
                "colour": place_colour(place),
                "parts": [rows[part] for part in place.parts],
                "faces": list(place.faces),
                "at": np.round(place.middle - centre, 5).tolist(),
                "lines": [np.round(line - centre, 5).tolist() for line in place_lines(place)],
            }
            for i, place in enumerate(places)
        ],
    }


def page_meshes(meshes: Iterable[TriangleMesh], centre: Array, most: int) -> tuple[list[PageMesh], float]:
    """Return the meshes of parts for a page, and their largest distance from the faces.

    If there are more than `most` triangles, the vertices in each cell of a grid are merged into their mean, with the
    finest grid that leaves few enough triangles. The origin of the page, `centre` (3,), should be near the parts, where
    single precision is most accurate.
    """
    meshes = list(meshes)
    drawn, moved = meshes, 0.0
    if _count(meshes) > most:
        finest = max(float(np.ptp(mesh.vertices, axis=0).max()) for mesh in meshes if len(mesh.vertices)) / _FINEST
        cells = finest * _WIDER ** np.arange(_STEPS)
        enough = bisect_left(cells, True, key=lambda cell: _count(coarser(mesh, cell)[0] for mesh in meshes) <= most)
        made = [coarser(mesh, cells[enough]) for mesh in meshes]
        drawn, moved = [mesh for mesh, _ in made], max(each for _, each in made)
    deflection = max((mesh.deflection for mesh in meshes), default=0.0)
    return [_of_page(mesh, centre) for mesh in drawn], deflection + moved


def coarser(mesh: TriangleMesh, cell: float) -> tuple[TriangleMesh, float]:
    """Return a mesh with the vertices in each cell of a grid of side `cell` merged, and their largest displacement."""
    if not len(mesh.triangles):
        return mesh, 0.0
    grid = np.floor((mesh.vertices - mesh.vertices.min(axis=0)) / cell).astype(np.int64)
    place = _numbered(np.ravel_multi_index(tuple(grid.T), tuple(grid.max(axis=0) + 1)))
    sums = [np.bincount(place, coordinate) for coordinate in mesh.vertices.T]
    middles = np.stack(sums, axis=1) / np.bincount(place)[:, None]
    faces = np.zeros(len(mesh.vertices), np.int64)
    faces[mesh.triangles] = mesh.faces[:, None]
    # Vertices are kept per face, so that edges between faces stay sharp, but coincide with those of neighbouring faces.
    vertex = _numbered(place * (faces.max() + 1) + faces)
    vertices = np.zeros((vertex.max() + 1, 3))
    vertices[vertex] = middles[place]
    places = place[mesh.triangles]
    kept = (places != np.roll(places, 1, axis=1)).all(axis=1)
    less = replace(mesh, vertices=vertices, triangles=vertex[mesh.triangles[kept]], faces=mesh.faces[kept])
    return less, float(np.linalg.norm(middles[place] - mesh.vertices, axis=1).max())


def _count(meshes: Iterable[TriangleMesh]) -> int:
    return sum(len(mesh.triangles) for mesh in meshes)


def _numbered(keys: Integers) -> Integers:
    return np.asarray(np.unique(keys, return_inverse=True)[1].ravel(), np.int64)


def _of_page(mesh: TriangleMesh, centre: Array) -> PageMesh:
    """Return a mesh in single precision, sorted by face, without unused vertices."""
    order = np.argsort(mesh.faces, kind="stable")
    used, triangles = np.unique(mesh.triangles[order], return_inverse=True)
    numbers, firsts, counts = np.unique(mesh.faces[order], return_index=True, return_counts=True)
    return PageMesh(
        vertices=(mesh.vertices[used] - centre).astype(np.float32),
        triangles=triangles.reshape(-1, 3).astype(np.uint32),
        stretches={n: (first, count) for n, first, count in np.stack([numbers, firsts, counts], axis=1).tolist()},
    )
