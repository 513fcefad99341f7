"""The page that shows what was found in a CAD file; it is one self-contained HTML file."""

import json
import re
from base64 import b64encode
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from markupsafe import Markup

from campaign.import_page.page_meshes import MOST_TRIANGLES, PageMesh, page_meshes
from campaign.pictures.sketches.found_sketch import part_colour, place_colour, place_lines, view_of
from engine.arrays import Array
from engine.cad import CadPart
from engine.cad_import.found_geometry import FoundGeometry
from engine.cad_import.found_places import FoundPlace, part_text
from engine.cad_import.proposed_text import OpenQuestion
from reporting.render.page_templates import page_environment

_FILES = resources.files("campaign.import_page") / "static"
_ABOUT = re.compile(r"(bodies|joints)\.([\w-]+)")
KINDS = {
    "joint": "Joints",
    "facing": "Faces that could be stops",
    "no joint": "Pins and holes that form no joint",
}


@dataclass(frozen=True)
class ImportFiles:
    """The files that the page is about."""

    step: str  # name of the CAD file
    mechanism: str  # name of the mechanism file
    drawing: bytes  # SVG of the parts and the joints found


def import_page(
    found: FoundGeometry, places: list[FoundPlace], questions: list[OpenQuestion], files: ImportFiles
) -> str:
    """Return the page as HTML; `places` are joints and candidates, `questions` the open ones of the mechanism file."""
    vertices = np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in found.assembly.meshes)])
    low, high = (vertices.min(axis=0), vertices.max(axis=0)) if len(vertices) else (np.zeros(3), np.ones(3))
    centre = (low + high) / 2
    meshes, deviation = page_meshes(found.assembly.meshes, centre, MOST_TRIANGLES)
    names = _names(found, places)
    scene = _scene(found, places, meshes, centre) | {"size": float(np.linalg.norm(high - low))}
    return (
        page_environment("campaign.import_page")
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


def _names(found: FoundGeometry, places: list[FoundPlace]) -> dict[tuple[str, str], str]:
    """Return the id of the row of each table of the mechanism file, by kind and name of the table."""
    names = {("bodies", found.bodies[part.name]): row for row, part in _parts(found).items()}
    return names | {("joints", p.name): f"place-{i}" for i, p in enumerate(places) if p.kind == "joint"}


def _about(question: OpenQuestion) -> tuple[str, str]:
    """Return the kind and name of the table that a question is about; empty texts if it is about no body or joint."""
    match = _ABOUT.match(question.text)
    return (match[1], match[2]) if match else ("", "")


def _scene(found: FoundGeometry, places: list[FoundPlace], meshes: list[PageMesh], centre: Array) -> dict[str, Any]:
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
