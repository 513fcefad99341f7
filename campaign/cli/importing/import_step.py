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
        float | None,
        typer.Option(
            help="How far a spline may be from the plane or cylinder it is taken for, in mm; default: 1e-4, with"
            " --update that of the mechanism file.",
            show_default=False,
        ),
    ] = None,
    pictures: Annotated[
        bool | None,
        typer.Option(
            help="Draw what was found beside the mechanism file, as .svg and in 3D as .html: with --output unless you"
            " say no, with --update only if you say so, over earlier ones.",
            show_default=False,
        ),
    ] = None,
    accept_damage: Annotated[
        bool, typer.Option("--accept-damage", help="Take what can be read of a damaged STEP file.")
    ] = False,
    json: Json = False,
) -> None:
    """Propose a mechanism file from a STEP file: parts, joints, play, and what only you know as marked questions."""
    from campaign.cli.importing.found_in_step import draw_found, found_in_step, picture_files
    from campaign.cli.importing.step_revision import bring_to_revision, campaign_file
    from campaign.cli.output_files import check_output, replacing
    from campaign.errors import SpecError
    from campaign.spec.proposed_campaign import proposed_campaign
    from engine.cad import RECOGNITION
    from engine.cad_import.proposed_joints import all_diameters
    from engine.cad_import.proposed_mechanism import proposed_mechanism, unloaded_directions
    from engine.cad_import.proposed_text import open_questions

    if (output is None) == (update is None):
        raise SpecError("one of --output and --update is needed; name the mechanism file that is to be written")
    if update is not None:
        bring_to_revision(
            update, step_file, recognition, accept_damage=accept_damage, pictures=pictures is True, json=json
        )
        return
    assert output is not None
    campaign = campaign_file(output)
    check_output("--output", output, (".toml",))
    _refuse_existing(output, "may hold answers")
    drawn = [] if pictures is False else picture_files(output)
    for each in drawn:
        _refuse_existing(each, "import draws into it; leave the pictures out with --no-pictures")
    asked = RECOGNITION if recognition is None else recognition
    found = found_in_step(step_file, asked, accept_damage=accept_damage)
    name = _name(output.stem)
    file = os.path.relpath(step_file, output.parent)
    text = proposed_mechanism(found, file, name)
    # twice: the first text is the mechanism in which motions are sought that no load acts on; the second asks about
    # them
    text = proposed_mechanism(found, file, name, unloaded_directions(found, text))
    diameters = all_diameters(found)
    if diameters:
        _refuse_existing(campaign, "may hold answers")
        with replacing(campaign) as temporary:
            temporary.write_text(proposed_campaign(diameters, output.name, f"{name}-limits"), "utf-8")
    with replacing(output) as temporary:
        temporary.write_text(text, "utf-8")
    if drawn:
        draw_found(found, text, step_file, output)
    written = [str(each) for each in (output, *([campaign] if diameters else []), *drawn)]
    questions = open_questions(text)
    if json:
        print_json({**_document(found), "questions": [each.text for each in questions], "written": written})
        return
    _print(found)
    for question in questions:
        print_text(f"question, line {question.line}: {question.text}")
    print_text(f"written: {', '.join(written)}; {len(questions)} questions are open")


def _refuse_existing(path: Path, why: str) -> None:
    """Raise SpecError if a file exists, instead of overwriting it."""
    from campaign.errors import SpecError

    if path.exists():
        raise SpecError(f"{path}: exists already, and {why}; name another file with --output, or move it")


def _name(stem: str) -> str:
    """Return the name of the mechanism for a file."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in stem).strip("-_")
    return name if name[:1].isalpha() else f"mechanism-{name}".rstrip("-")


def _document(found: "FoundGeometry") -> dict[str, Any]:
    """Return the found geometry as plain data; lengths in mm."""
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
        "stops": [
            {
                "name": stop.name,
                "parts": list(stop.pair.parts),
                "kinds": [face[number].kind for number in stop.pair.faces],
                "gap": stop.pair.gap,
                "area": getattr(stop.pair, "area", None),
            }
            for stop in found.stops
        ],
        "refused": [
            {"hole_of": face[miss.hole].part, "pin_of": face[miss.pin].part, "reason": miss.reason}
            for miss in found.refused
        ],
        "left_out": list(found.assembly.cautions),
    }


def _print(found: "FoundGeometry") -> None:
    """Print the found geometry."""
    from engine.cad_import.found_places import found_places, part_text

    for part in found.assembly.parts:
        print_text(part_text(part))
    for place in found_places(found):
        print_text(place.text)
    for text in found.assembly.cautions:
        print_text(f"left out: {text}")
