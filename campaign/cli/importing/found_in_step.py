"""The geometry found in a STEP file, for `clearcap mechanism import`, and its pictures."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from engine.cad_import.found_geometry import FoundGeometry


def found_in_step(step_file: str, recognition: float, *, accept_damage: bool) -> "FoundGeometry":
    """Read a STEP file and find its joints; SpecError if it yields no mechanism, or if it is damaged."""
    from campaign.errors import SpecError
    from engine.cad import read_step
    from engine.cad_import.found_geometry import find_geometry

    assembly = read_step(step_file, recognition)
    if assembly.damage and not accept_damage:
        raise SpecError(f"{step_file}: {assembly.damage}, or take what is left with --accept-damage")
    found = find_geometry(assembly)
    if (parts := len(found.assembly.parts)) < 2:
        raise SpecError(
            f"{step_file}: holds {'one part' if parts else 'no parts'}; allowed: two or more, one of them fixed; export"
            " the assembly, not a single part"
        )
    return found


def picture_files(mechanism: Path) -> list[Path]:
    """Return the files of the drawing and of the page beside a mechanism file."""
    return [mechanism.with_suffix(".svg"), mechanism.with_suffix(".html")]


def draw_found(found: "FoundGeometry", text: str, step_file: str, mechanism: Path) -> None:
    """Write the pictures of the found geometry, with the questions of a mechanism file."""
    from campaign.cli.output_files import replacing
    from campaign.import_page.import_page import ImportFiles, import_page
    from campaign.pictures.sketches.found_sketch import sketch_found
    from campaign.pictures.sketches.sketch_figure import plot_sketch
    from engine.cad_import.found_places import found_places
    from engine.cad_import.proposed_text import open_questions

    drawing, page = picture_files(mechanism)
    places, title = found_places(found), Path(step_file).name
    said = "; ".join(place.text for place in places)
    with replacing(drawing) as temporary:
        plot_sketch(sketch_found(found, places), f"{title}: what was found", said, temporary)
    files = ImportFiles(title, mechanism.name, drawing.read_bytes())
    with replacing(page) as temporary:
        temporary.write_text(import_page(found, places, open_questions(text), files), "utf-8")
