"""``clearcap mechanism import``."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.cli.output import Json, print_json, print_text

if TYPE_CHECKING:
    from engine.cad_import.found_geometry import FoundGeometry


def import_step(
    step_file: Annotated[str, typer.Argument(metavar="STEP", help="A STEP file: .step or .stp.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The mechanism file to write: .toml.")] = None,
    update: Annotated[
        Path | None, typer.Option(help="A mechanism file of an earlier revision: say what moved, keep what you wrote.")
    ] = None,
    recognition: Annotated[
        float, typer.Option(help="How far a spline may be from the plane or cylinder it is taken for [mm].")
    ] = 1e-4,
    pictures: Annotated[
        bool | None,
        typer.Option(
            help="Draw what was found beside the mechanism file, as .svg and in 3D as .html: with --output unless you"
            " say no, with --update only if you say so, over earlier ones.",
            show_default=False,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Propose a mechanism file from a STEP file: parts, joints, play, and what only you know as marked questions."""
    from campaign.cli.output_files import check_output, replacing
    from campaign.errors import SpecError
    from campaign.spec.proposed_campaign import proposed_campaign
    from engine.cad import read_step
    from engine.cad_import.found_geometry import find_geometry
    from engine.cad_import.open_questions import open_questions
    from engine.cad_import.proposed_joints import diameters_of
    from engine.cad_import.proposed_mechanism import proposed_mechanism
    from engine.cad_import.unloaded_directions import unloaded_directions

    if (output is None) == (update is None):
        raise SpecError("one of --output and --update is needed; name the mechanism file that is to be written")
    if update is not None:
        _update(step_file, update, recognition, pictures is True, json)
        return
    assert output is not None
    campaign = output.with_name(f"{output.stem}-campaign.toml")
    check_output("--output", output, (".toml",))
    _refuse_existing(output, "may hold answers")
    drawn = [] if pictures is False else _picture_files(output)
    for each in drawn:
        _refuse_existing(each, "import draws into it; leave the pictures out with --no-pictures")
    found = find_geometry(read_step(step_file, recognition))
    _refuse_empty(found, step_file)
    name = _name(output.stem)
    file = os.path.relpath(step_file, output.parent)
    text = proposed_mechanism(found, file, name)
    text = proposed_mechanism(found, file, name, unloaded_directions(found, text))
    diameters = [each for joint in found.joints for each in diameters_of(found, joint).values()]
    if diameters:
        _refuse_existing(campaign, "may hold answers")
        with replacing(campaign) as temporary:
            temporary.write_text(proposed_campaign(diameters, output.name, f"{name}-limits"), "utf-8")
    with replacing(output) as temporary:
        temporary.write_text(text, "utf-8")
    if drawn:
        _draw(found, text, step_file, output)
    written = [str(each) for each in (output, *([campaign] if diameters else []), *drawn)]
    questions = open_questions(text)
    if json:
        print_json({**_document(found), "questions": [each.text for each in questions], "written": written})
        return
    _print(found)
    for question in questions:
        print_text(f"question, line {question.line}: {question.text}")
    print_text(f"written: {', '.join(written)}; {len(questions)} questions are open")


def _update(step_file: str, path: Path, recognition: float, pictures: bool, json: bool) -> None:
    """Bring a mechanism file to a new revision of its STEP file, and print what changed."""
    from difflib import unified_diff

    from campaign.cli.output_files import check_output, replacing
    from engine.cad import read_step
    from engine.cad_import.earlier_revision import earlier_revision
    from engine.cad_import.found_geometry import find_geometry
    from engine.cad_import.proposed_mechanism import proposed_mechanism
    from engine.cad_import.updated_mechanism import updated_mechanism

    check_output("--update", path, (".toml",))
    earlier = earlier_revision(path)
    found = find_geometry(read_step(step_file, recognition))
    _refuse_empty(found, step_file)
    before = proposed_mechanism(find_geometry(earlier.assembly), earlier.file, earlier.name)
    after = proposed_mechanism(found, os.path.relpath(step_file, path.parent), earlier.name)
    updated = updated_mechanism(earlier.text, before, after)
    with replacing(path) as temporary:
        temporary.write_text(updated.text, "utf-8")
    drawn = _picture_files(path) if pictures else []
    if drawn:
        _draw(found, updated.text, step_file, path)
    written = [str(each) for each in (path, *drawn)]
    old, new = earlier.text.splitlines(), updated.text.splitlines()
    changes = list(unified_diff(old, new, str(path), str(path), lineterm="", n=1))
    if json:
        lists = {"kept": updated.kept, "gone": updated.gone, "added": updated.added}
        print_json({"changes": changes, **lists, "written": written})
        return
    for line in changes:
        print_text(line)
    for text in updated.kept:
        print_text(f"kept as you wrote it: {text}")
    for table in updated.gone:
        print_text(f"no longer in the STEP file: {table}; remove it, or name other faces")
    if not changes:
        print_text(f"{path}: nothing has changed")
    if changes or drawn:
        print_text(f"written: {', '.join(written if changes else written[1:])}")


def _picture_files(mechanism: Path) -> list[Path]:
    """Return the files of the drawing and of the page beside a mechanism file."""
    return [mechanism.with_suffix(".svg"), mechanism.with_suffix(".html")]


def _draw(found: "FoundGeometry", text: str, step_file: str, mechanism: Path) -> None:
    """Write the pictures of what was found, with the questions of a mechanism file."""
    from campaign.cli.output_files import replacing
    from campaign.import_page.import_page import ImportFiles, import_page
    from campaign.pictures.sketches.found_sketch import sketch_found
    from campaign.pictures.sketches.sketch_figure import plot_sketch
    from engine.cad_import.found_places import found_places
    from engine.cad_import.open_questions import open_questions

    drawing, page = _picture_files(mechanism)
    places, title = found_places(found), Path(step_file).name
    said = "; ".join(place.text for place in places)
    with replacing(drawing) as temporary:
        plot_sketch(sketch_found(found, places), f"{title}: what was found", said, temporary)
    files = ImportFiles(title, mechanism.name, drawing.read_bytes())
    with replacing(page) as temporary:
        temporary.write_text(import_page(found, places, open_questions(text), files), "utf-8")


def _refuse_existing(path: Path, why: str) -> None:
    """Refuse to write over a file."""
    from campaign.errors import SpecError

    if path.exists():
        raise SpecError(f"{path}: exists already, and {why}; name another file with --output, or move it")


def _refuse_empty(found: "FoundGeometry", step_file: str) -> None:
    """Refuse a file of which no mechanism can be made."""
    from campaign.errors import SpecError

    parts = len(found.assembly.parts)
    if parts < 2:
        raise SpecError(
            f"{step_file}: holds {'one part' if parts else 'no parts'}; allowed: two or more, one of them fixed; export"
            " the assembly, not a single part"
        )


def _name(stem: str) -> str:
    """Return a name of a mechanism for a file."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in stem).strip("-_")
    return name if name[:1].isalpha() else f"mechanism-{name}".rstrip("-")


def _document(found: "FoundGeometry") -> dict[str, Any]:
    """Return what was found as plain data; lengths in mm."""
    face = {f.number: f for f in found.assembly.faces}
    return {
        "parts": [
            {
                "name": part.name,
                "body": found.bodies[part.name],
                "path": list(part.path),
                "volume": sum(solid.volume for solid in part.solids),
                "material": part.material.name if part.material else None,
            }
            for part in found.assembly.parts
        ],
        "joints": [
            {
                "name": joint.name,
                "bearing": joint.pin.bearing,
                "journal": joint.pin.journal,
                "hole_radius": joint.pin.seats[0].hole_radius,
                "pin_radius": joint.pin.seats[0].pin_radius,
                "radial_clearance": joint.pin.radial_clearance,
                "axial_plays": {flange.side: flange.play for flange in joint.flanges},
                "point": joint.pin.point.tolist(),
                "axis": joint.pin.axis.tolist(),
            }
            for joint in found.joints
        ],
        "balls": [
            {
                "name": each.name,
                "socket": each.ball.socket_part,
                "ball": each.ball.ball_part,
                "socket_radius": each.ball.socket_radius,
                "ball_radius": each.ball.ball_radius,
                "radial_clearance": each.ball.radial_clearance,
                "centre": each.ball.centre.tolist(),
            }
            for each in found.balls
        ],
        "stops": [{"parts": list(pair.parts), "gap": pair.gap, "area": pair.area} for pair in found.stops],
        "refused": [
            {"hole_of": face[miss.hole].part, "pin_of": face[miss.pin].part, "reason": miss.reason}
            for miss in found.refused
        ],
        "left_out": list(found.assembly.cautions),
    }


def _print(found: "FoundGeometry") -> None:
    """Print what was found."""
    from engine.cad_import.found_places import found_places, part_text

    for part in found.assembly.parts:
        print_text(part_text(part))
    for place in found_places(found):
        print_text(place.text)
    for text in found.assembly.cautions:
        print_text(f"left out: {text}")
