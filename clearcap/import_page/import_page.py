"""The page that shows what was found in a CAD file: one self-contained HTML file with triangle meshes of the parts."""

import json
import re
from base64 import b64encode
from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from clearcap.pictures.sketches.found_sketch import part_colour, place_colour, place_lines, view_of
from engine.arrays import Array, Integers
from engine.cad import CadPart
from engine.cad.cad_model import TriangleMesh
from engine.cad_import.found_features import FoundFeature, part_text
from engine.cad_import.found_geometry import FoundGeometry
from engine.cad_import.proposed_text import OpenQuestion
from reporting.render.page_templates import page_environment

MOST_TRIANGLES = 250_000
"""Limit for all parts together; beyond it the parts are drawn coarser. A page of this many has about 8 MB."""
_FILES = resources.files("clearcap.import_page") / "static"
_ABOUT = re.compile(r"(bodies|joints)\.([\w-]+)")
KINDS = {
    "joint": "Joints",
    "facing": "Faces that could be stops",
    "no joint": "Pins and holes that form no joint",
}


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


def import_page(
    found: FoundGeometry, places: list[FoundFeature], questions: list[OpenQuestion], files: ImportFiles
) -> str:
    """Return the page as HTML; `places` are joints and candidates, `questions` the open ones of the mechanism file."""
    vertices = np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in found.assembly.meshes)])
    low, high = (vertices.min(axis=0), vertices.max(axis=0)) if len(vertices) else (np.zeros(3), np.ones(3))
    centre = (low + high) / 2
    meshes, deviation = page_meshes(found.assembly.meshes, centre, MOST_TRIANGLES)
    names = _names(found, places)
    scene = _scene(found, places, meshes, centre) | {"size": float(np.linalg.norm(high - low))}
    return (
        page_environment("clearcap.import_page")
        .get_template("import_page.html.j2")
        .render(
            found=found,
            files=files,
            drawing=b64encode(files.drawing).decode(),
            drawing_text=f"The parts, seen along most of the axes. {'; '.join(place.text for place in places)}",
            parts=[(row, part, part_colour(found, part.name)) for row, part in _parts(found).items()],
            part_text=part_text,
            kinds=[(title, [p for p in enumerate(places) if p[1].kind == kind]) for kind, title in KINDS.items()],
            questions=[(question, names.get(_about(question))) for question in questions],
            deviation=deviation,
            scene=Markup(json.dumps(scene).replace("<", "\\u003c")),  # so that no text can end the script element
            three=_source("three.min.js"),
            script=_source("import_page.js"),
            style=_source("import_page.css"),
        )
    )


def _parts(found: FoundGeometry) -> dict[str, CadPart]:
    """Return the parts by the ids of their rows on the page."""
    return {f"part-{number}": part for number, part in enumerate(found.assembly.parts)}


def _names(found: FoundGeometry, places: list[FoundFeature]) -> dict[tuple[str, str], str]:
    """Return the id of the row of each table of the mechanism file, by kind and name of the table."""
    names = {("bodies", found.bodies[part.name]): row for row, part in _parts(found).items()}
    return names | {("joints", p.name): f"place-{i}" for i, p in enumerate(places) if p.kind == "joint"}


def _about(question: OpenQuestion) -> tuple[str, str]:
    """Return the kind and name of the table that a question is about; empty texts if it is about no body or joint."""
    match = _ABOUT.match(question.text)
    return (match[1], match[2]) if match else ("", "")


def _scene(found: FoundGeometry, places: list[FoundFeature], meshes: list[PageMesh], centre: Array) -> dict[str, Any]:
    """Return the data that the page's script draws, as plain data; positions relative to the centre [mm]."""
    view = view_of(found)
    rows = {part.name: row for row, part in _parts(found).items()}
    wanted = {face for place in places for face in place.faces}
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


def _source(name: str) -> Markup:
    """Return the content of a static file of the page, unescaped."""
    return Markup((_FILES / name).read_text("utf-8"))


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
    """Return a mesh whose vertices in each cell of a grid are merged, and the largest displacement of a vertex.

    Triangles that collapse are left out; `cell` is the side length of a cell, > 0.
    """
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
    """Return the total number of triangles."""
    return sum(len(mesh.triangles) for mesh in meshes)


def _numbered(keys: Integers) -> Integers:
    """Return the rank of each key among the distinct keys."""
    return np.asarray(np.unique(keys, return_inverse=True)[1].ravel(), np.int64)


def _of_page(mesh: TriangleMesh, centre: Array) -> PageMesh:
    """Return a mesh in single precision, sorted by face, without unused vertices."""
    order = np.argsort(mesh.faces, kind="stable")
    used, triangles = np.unique(mesh.triangles[order], return_inverse=True)
    numbers, firsts, counts = np.unique(mesh.faces[order], return_index=True, return_counts=True)
    return PageMesh(
        vertices=(mesh.vertices[used] - centre).astype(np.float32),
        triangles=triangles.reshape(-1, 3).astype(np.uint32),
        stretches=_stretches(numbers, firsts, counts),
    )


def _stretches(numbers: Integers, firsts: Integers, counts: Integers) -> dict[int, tuple[int, int]]:
    rows = zip(numbers.tolist(), firsts.tolist(), counts.tolist(), strict=True)
    return {number: (first, count) for number, first, count in rows}
